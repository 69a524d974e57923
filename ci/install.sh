#!/usr/bin/env bash
# Installs the grader, with the versions that it was tested with, on a Debian or Ubuntu of a CI job.
#
#   install.sh SOURCE
#
# It goes to /opt/grade and belongs to root, so that no student's code can change it.
set -euo pipefail
source=$(realpath -- "$1")
# The working folder of a job is a submission, whose modules Python would import.
cd /
unset PYTHONPATH PYTHONHOME
as_root() { if [[ $(id -u) == 0 ]]; then "$@"; else sudo -- "$@"; fi; }

as_root apt-get update -qq
as_root env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends \
  bubblewrap cmake g++ gcc libc6-dev libssl-dev make python3 python3-dev python3-venv util-linux >/dev/null
python3 -I -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
  echo "install.sh: the grader needs Python 3.11 or newer, and here is $(python3 -I -V)." >&2
  echo "  Choose Ubuntu 24.04 or Debian 12, or a newer one." >&2
  exit 1
}
as_root python3 -I -m venv /opt/grade
as_root /opt/grade/bin/python -I -m pip install --quiet --disable-pip-version-check --no-cache-dir \
  --constraint "$source/constraints.txt" "${source}[desk,mujoco,scipy]"
