"""The greedy planner: makes a legal plan for any situation, without a search and without a solver.

`planner.Greedy` is created once for a spec, and then makes a plan for each situation.
"""
