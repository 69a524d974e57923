"""An autograder for ROS 2 lab submissions: record once on a live graph, judge for ever.

The live half (`grader.live`) runs a student's nodes beside reference nodes and writes a
*recording*. The judging half (`grader.judging` and its imports) turns a recording and a rubric into
a result and its page, without ROS.
"""

import os

# Pydantic would look for plugins in each installed package, in 10 ms of each process.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
# numpy's library would start a thread a core, which spins at first: in 20 to 60 ms of each process.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "1.0.0"
