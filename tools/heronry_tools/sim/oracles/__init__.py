"""The oracles: each verifies in every simulated flight one thing that must hold.

An oracle reads the frames on the buses and the faults that were injected. It asks no core of a manager or PE.
"""
