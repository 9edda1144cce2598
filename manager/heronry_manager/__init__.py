"""Decides: the planner and the system manager."""
