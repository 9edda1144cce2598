"""The oracles: each verifies one thing that must hold in every simulated flight.

An oracle reads the frames on the buses and knows the faults that were injected. It does not read the state of a manager
or a PE.
"""
