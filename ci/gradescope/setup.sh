#!/usr/bin/env bash
# Gradescope runs this once, as root, when it makes the autograder's image.
set -euo pipefail
bash /autograder/source/ci/install.sh /autograder/source
