#!/usr/bin/env bash
# Grades a submission in a job of GitLab CI; see gitlab-ci.yml, which sets the variables.
#
# Exit status: that of `grade`. It is not 0 if the score is below FAIL_UNDER, or if there is no score.
set -euo pipefail
# Modules and libraries come from the grader alone: an empty entry in one of these is the working folder, a submission.
unset PYTHONPATH PYTHONHOME LD_LIBRARY_PATH LD_PRELOAD
GRADE=${GRADE:-/opt/grade/bin/grade}
# Not within the checkout, where the submission may have laid out links.
results=$(mktemp -d)

# A name alone, such as "lab", could be taken for a command.
path=$SUBMISSION
[[ $path == /* ]] || path=./$path
arguments=("$path" --one --output "$results" --require-isolation "$REQUIRE_ISOLATION")
[[ -z ${RUBRIC:-} ]] || arguments+=(--rubric "$RUBRIC")
[[ -z ${SESSIONS:-} ]] || arguments+=(--sessions "$SESSIONS")
[[ -z ${FAIL_UNDER:-} ]] || arguments+=(--fail-under "$FAIL_UNDER")
status=0
"$GRADE" "${arguments[@]}" || status=$?

result=$(find "$results" -mindepth 2 -maxdepth 2 -name result.json -print -quit)
if [[ -n $result ]]; then
  folder=$(dirname "$result")
  "$GRADE" export "$folder" --to junit --to gitlab-codequality --path-prefix "$SUBMISSION" >/dev/null
  # GitLab takes artifacts from the checkout alone.
  rm -rf -- "$CI_PROJECT_DIR/grade"
  cp -R -- "$folder" "$CI_PROJECT_DIR/grade"
  echo "Of this job's artifacts, grade/report.html is the report."
fi
rm -rf -- "$results"
exit "$status"
