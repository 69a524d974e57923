"""The director: the grader's ROS node, its recorder, its graph. Imports no other folder of the live half."""
