"""Recordings and rubric → result and page; pure. Imports the checks, the report, a class's entries."""
