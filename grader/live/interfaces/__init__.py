"""Interface packages of labs and students, built by rosidl and a compiler; of the live half it imports `sandbox`.

The grader's own processes load libraries built from a student's definitions, because the recorder needs the support
of each type. Therefore no build file of a package is run, and its definitions are compiled in a sandbox
(`inside/build_package.py`).
"""
