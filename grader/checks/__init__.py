"""Checks: functions of the evidence and of parameters that decide about behaviour, not about points."""
