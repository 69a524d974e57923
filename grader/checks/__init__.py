"""What is right: functions of the evidence and of parameters; they know nothing of points. Imports the evidence."""
