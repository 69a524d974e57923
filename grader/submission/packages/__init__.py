"""ROS packages of students; only here are their build files read. Imports the recording's format."""
