"""The simulator: the manager and agent cores that fly, unchanged, on simulated buses in virtual time.

One seed determines a flight.
"""
