"""`grade doctor`: what this machine can do, and how to fix what it cannot. Imports what grading does."""
