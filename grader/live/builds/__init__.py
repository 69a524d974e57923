"""ROS packages of students, built by colcon in a sandbox; of the live half it imports `sandbox` and `student_tap`.

The build files of a package are a student's programs: they run without a network, without the grader's files, and
within a time. The facts of a build are recorded, and judging reads the record alone.
"""
