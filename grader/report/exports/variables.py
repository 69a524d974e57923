"""Environment variables that exports need; apart from the exports themselves, which a grading rarely makes."""

#: Facts about the submission from Classroom 50's runner: keys of its result, and the variables that hold their values.
CLASSROOM50 = {
    "classroom": "CLASSROOM",
    "assignment": "ASSIGNMENT",
    "submission": "SUBMISSION_TAG",
    "commit": "COMMIT_URL",
    "release": "RELEASE_URL",
}
