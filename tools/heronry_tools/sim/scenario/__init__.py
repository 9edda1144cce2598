"""Scenario files: what is done to an aircraft, what is expected to be heard of it, and what it decided then."""
