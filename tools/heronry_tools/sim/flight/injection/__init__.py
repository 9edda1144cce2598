"""Injects faults into a flight: `schedule` decides when; each other file has the faults of one kind of target."""
