"""`grade doctor`: abilities of this machine, and remedies for its problems. Imports the same as grading."""
