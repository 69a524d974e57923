"""Why a process ended or went wrong, in words for a student. Imports the recording's format."""
