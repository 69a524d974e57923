"""Numbers and facts of recordings and texts, without judgement. Imports the submission, the lab, the recording's format."""
