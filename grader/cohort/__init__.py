"""A class as a whole, from its results: statistics, adjustments, changes. Pure, like all of the judging half."""
