"""Downloads of learning-management systems, and their names for submissions. Imports the lab."""
