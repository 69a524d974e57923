#!/usr/bin/env bash
# Grades a submission in a job of GitHub Actions; see action.yml, which sets the variables.
#
# Exit status: that of `grade`. It is not 0 if the score is below FAIL_UNDER, or if there is no score.
set -euo pipefail
# Modules and libraries come from the grader alone: an empty entry in one of these is the working folder, a submission.
unset PYTHONPATH PYTHONHOME LD_LIBRARY_PATH LD_PRELOAD
GRADE=${GRADE:-/opt/grade/bin/grade}
as_root() { if [[ $(id -u) == 0 ]]; then "$@"; else sudo -- "$@"; fi; }

# A name alone, such as "lab", could be taken for a command.
path=$SUBMISSION
[[ $path == /* ]] || path=./$path
arguments=("$path" --one --output "$RESULTS" --require-isolation "$REQUIRE_ISOLATION")
[[ -z $RUBRIC ]] || arguments+=(--rubric "$RUBRIC")
[[ -z $SESSIONS ]] || arguments+=(--sessions "$SESSIONS")
[[ -z $FAIL_UNDER ]] || arguments+=(--fail-under "$FAIL_UNDER")

# Another step of this job may have graded another lab.
as_root rm -rf -- "$RESULTS"

# What a student wrote is printed among the rest. The grader leaves no command in it; and until the token
# is said, which nobody can guess, the runner would not obey one.
token=$(od -An -N16 -tx1 /dev/urandom | tr -d ' \n')
echo "::stop-commands::$token"
status=0
# As root: each session's student then has a user id of its own, without the runner's right to use sudo.
as_root "$GRADE" "${arguments[@]}" || status=$?
echo "::$token::"

[[ ! -d $RESULTS ]] || as_root chown -R "$(id -u):$(id -g)" "$RESULTS"
result=$(find "$RESULTS" -mindepth 2 -maxdepth 2 -name result.json -print -quit 2>/dev/null || true)
if [[ -z $result ]]; then
  echo "::error::The submission could not be graded; the log of this step says why."
  exit "$status"
fi
folder=$(dirname "$result")
"$GRADE" export "$folder" --to github-summary=- >>"$GITHUB_STEP_SUMMARY"
"$GRADE" export "$folder" --to github-annotations=- --path-prefix "$SUBMISSION"
"$(dirname "$GRADE")/python" -I - "$result" >>"$GITHUB_OUTPUT" <<'PYTHON'
import json, sys
score = json.load(open(sys.argv[1], encoding="utf-8"))["score"]
print(f"score={float(score['final']):g}\npossible={float(score['possible']):g}\nundecided={float(score['undecided']):g}")
PYTHON
[[ $status != 1 ]] || echo "::error::The score is below $FAIL_UNDER points."
exit "$status"
