"""Scenario files: what happens to an aircraft, what is expected to be heard of it, and what its manager decided."""
