"""The live half: it alone starts processes or knows ROS. Imports the lab, the submission, the recording's format."""
