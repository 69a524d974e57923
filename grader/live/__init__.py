"""The live half: the only part that starts processes or knows ROS."""
