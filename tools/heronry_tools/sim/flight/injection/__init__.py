"""Injects faults into a flight: `schedule` at the right time, the other files each for one kind of target."""
