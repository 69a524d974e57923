# The grader as an image. Which confinement of students' code a container permits depends on how it is started:
# docs/container.md has the flags for each level.
FROM debian:bookworm-slim

RUN apt-get update \
 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
      bubblewrap ca-certificates cmake g++ gcc git libc6-dev libssl-dev make python3 python3-dev python3-venv util-linux \
 && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/grader
COPY LICENSE README.md constraints.txt pyproject.toml rubric.schema.json rubric.yaml ./
COPY confine confine
COPY docs/grade.1 docs/grade.1
COPY grader grader
COPY labs labs
COPY launch_plan launch_plan
COPY reference reference
COPY ros_bag ros_bag
COPY submissions/alice submissions/alice
RUN python3 -m venv /opt/venv \
 && /opt/venv/bin/python -m pip install --no-cache-dir --disable-pip-version-check -c constraints.txt '.[desk,mujoco,scipy]' \
 && find /opt/venv -name '__pycache__' -prune -exec rm -rf {} + \
 && /opt/venv/bin/python -m compileall -q /opt/venv/lib

# Root is for who asks for it (`--user 0`): with a privileged container, that gives the best confinement.
RUN useradd --create-home --uid 1000 grader && mkdir /work && chown grader /work
USER grader
WORKDIR /work
ENV PATH=/opt/venv/bin:/usr/local/bin:/usr/bin:/bin \
    LANG=C.UTF-8
CMD ["grade", "--help"]
