"""Submissions: found and unpacked, never executed. Imports the lab and the recording's format."""
