"""What an instructor writes: rubric, steps, references, policy, overrides. Imports the recording's format only."""
