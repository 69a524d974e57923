"""Measurements of the grader's speed, accuracy and repeatability; not shipped with it."""
