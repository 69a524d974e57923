"""Processes of a session: forked, limited, watched, accounted. Imports the sandbox."""
