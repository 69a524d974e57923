"""What notes in a student's process (`inside/`), and how that is read. Imports no other folder here."""
