"""A class as a whole, summed up from its results; pure. Imports the lab, the submission and results."""
