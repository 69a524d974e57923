"""An instructor's files: rubric, steps, references, policy, overrides. Imports the recording's format only."""
