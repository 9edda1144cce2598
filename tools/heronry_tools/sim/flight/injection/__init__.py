"""Faults injected into a flight: when (`schedule`), and what each kind does, in one file for each kind of target."""
