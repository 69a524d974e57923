"""The evaluator: modules of the process that executes a launch file.

`evaluate.py` is the program. Nothing here imports pydantic or starts a process.
"""
