"""The greedy planner: a legal plan without a search, for any situation, without a solver.

`planner.Greedy` is created once for a spec, and then makes a plan for each situation.
"""
