"""What a student hands in: found, unpacked, never executed. Imports the lab and the recording's format."""
