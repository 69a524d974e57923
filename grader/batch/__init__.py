"""Many submissions: finding them, grading them side by side, going on where a run stopped."""
