"""`grade doctor`: what this machine can do, and what would mend what it cannot."""
