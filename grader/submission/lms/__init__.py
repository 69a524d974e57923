"""Downloads of learning-management systems: how each names what students handed in. Imports the lab."""
