"""Many submissions: graded side by side, on other machines too, judged again. Imports all but commands."""
