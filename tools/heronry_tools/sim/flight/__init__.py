"""Simulated flights: the simulated aircraft, the injection of faults, the outcome of a flight, campaigns, shrinking."""
