"""Plans of ROS 2 launch files: the processes that `ros2 launch` would start, found without starting any.

`launch_plan.evaluation.evaluate` evaluates a launch file, `launch_plan.plan.Plan` is the result, and README.md is the
manual. Only the standard library, pydantic and PyYAML are imported. This module stays empty, because readers of plans
must not load the code that starts the evaluator.
"""
