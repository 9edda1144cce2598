"""The simulator: runs the cores of managers and agents, the same code as in flight, on simulated buses in virtual time.

All random values come from one seed. So equal specs, seeds and faults give equal flights.
"""
