"""Causes of the end or the failure of a process, in words for a student. Imports the recording's format."""
