"""The oracles: each verifies in every simulated flight one thing that must hold.

An oracle reads the frames on the buses and knows the faults that were injected. It does not read the state of a manager
or a PE.
"""
