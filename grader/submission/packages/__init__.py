"""ROS packages of students; no other package reads their build files. Imports the recording's format."""
