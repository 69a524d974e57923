"""What the grader costs and how sure it is, measured; not shipped with it."""
