"""The simulator: the flight cores, unchanged, on simulated buses in virtual time; one seed determines a flight."""
