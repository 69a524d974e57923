"""A class as a whole, from its results; pure. Imports the lab, the submission and results."""
