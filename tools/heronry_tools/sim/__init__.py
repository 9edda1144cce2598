"""The simulator: the flight cores, unchanged, on simulated buses in virtual time, everything drawn from one seed."""
