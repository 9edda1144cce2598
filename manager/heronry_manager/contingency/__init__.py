"""Plans made ahead: the file that holds them, the look-up in flight, and the part that fits into the PEs.

The sweep that makes them is `heronry_manager.planner.sweep`. In flight only this package is needed, and no solver.
"""
