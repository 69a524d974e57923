"""Numbers and facts; knows nothing of right or wrong. Imports the submission, the lab, the recording's format."""
