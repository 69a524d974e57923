"""An autograder for ROS 2 lab submissions: record once on a live graph, judge for ever.

The live half (`grader.live`) runs a student's nodes beside reference nodes and writes a
*recording*. The judging half (`grader.judging` and its imports) turns a recording and a rubric into
a result and its page, without ROS.
"""

__version__ = "1.0.0"
