"""Interface packages of labs and students, built by rosidl and a compiler; of the live half it imports `sandbox`.

What is built of a student's text is loaded by the grader's own processes too, since the recorder needs the support of
each type. So no build file of a package is run (its CMakeLists.txt is a program), the definitions are read and compiled
in a sandbox, and of them only names, types, numbers and plain texts reach the generators.
"""
