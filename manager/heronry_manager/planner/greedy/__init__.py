"""The greedy planner: a legal plan without a search, for any situation, without a solver.

`planner.Greedy` is made once for a spec, and plans.
"""
