"""Contingencies, the plans made ahead: their file, the journal of an unfinished sweep, and the look-up in flight.

The sweep that makes the plans is `heronry_manager.planner.sweep`. In flight only this package is needed, and no solver.
"""
