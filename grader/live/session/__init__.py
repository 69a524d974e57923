"""Sessions of a submission: staged, scheduled, run step by step. Imports all other folders of the live half."""
