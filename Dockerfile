# The grader as an image, in two sizes. `--target slim` has no compiler; `full`, the default, also builds packages in C and C++
# and own interfaces. Which confinement of students' code a container permits depends on how it is started:
# docs/container.md has the flags for each level.
FROM debian:bookworm-slim AS build

RUN apt-get update \
 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends ca-certificates python3 python3-venv \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/*

WORKDIR /opt/grader
COPY constraints.txt requirements.lock ./
# The packages change rarely; this layer is kept while only the grader changes.
RUN python3 -m venv /opt/venv \
 && /opt/venv/bin/python -m pip install --no-cache-dir --no-compile --disable-pip-version-check --require-hashes -r requirements.lock
COPY LICENSE README.md pyproject.toml rubric.schema.json rubric.yaml ./
COPY confine confine
COPY docs/grade.1 docs/grade.1
COPY grader grader
COPY labs labs
COPY launch_plan launch_plan
COPY reference reference
COPY ros_bag ros_bag
COPY submissions/alice submissions/alice
# Neither compiled nor needed for grading: modules of tests, and some tools.
RUN PIP_CONSTRAINT=constraints.txt /opt/venv/bin/python -m pip install --no-cache-dir --no-compile --no-deps --disable-pip-version-check . \
 && find /opt/venv -name __pycache__ -prune -exec rm -rf {} + \
 && find /opt/venv/lib/*/site-packages/scipy /opt/venv/lib/*/site-packages/apsw -name tests -prune -exec rm -rf {} + \
 && mv /opt/venv/include /opt/include \
 && /opt/venv/bin/python -m compileall -qq -x '/(tests?|testing|_pytest|docutils|pip|pygments|setuptools)/' /opt/venv/lib

FROM debian:bookworm-slim AS slim

RUN apt-get update \
 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends bubblewrap ca-certificates python3 util-linux \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/*
COPY --from=build /opt/venv /opt/venv
# In a privileged container, root (`--user 0`) confines students best.
RUN useradd --create-home --uid 1000 grader && mkdir /work && chown grader /work
USER grader
WORKDIR /work
ENV PATH=/opt/venv/bin:/usr/local/bin:/usr/bin:/bin \
    LANG=C.UTF-8
# The examination takes some seconds of a core, which would disturb measurements if it came often.
HEALTHCHECK --interval=30m --timeout=2m --retries=2 CMD ["grade", "doctor"]
CMD ["grade", "--help"]

FROM slim AS full

USER root
COPY --from=build /opt/include /opt/venv/include
RUN apt-get update \
 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends cmake g++ gcc libc6-dev libssl-dev make python3-dev \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/*
USER grader
