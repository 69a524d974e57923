"""Texts of programs, comments, READMEs and printed results. Imports the rest of the evidence."""
