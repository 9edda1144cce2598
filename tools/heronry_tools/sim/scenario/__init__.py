"""Scenario files: what happens to an aircraft, which frames are expected, and what the manager decided."""
