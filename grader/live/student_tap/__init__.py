"""The tap in a student's process (`inside/`), and the reading of its notes. Imports no other folder here."""
