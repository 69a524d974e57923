"""What texts say: programs, comments, READMEs, printed results. Imports the rest of the evidence."""
