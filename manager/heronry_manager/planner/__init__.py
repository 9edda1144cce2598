"""The exact planner: the best legal configuration for any situation, with proof.

`exact.plan` plans in this process. `client.PlannerClient` plans in a process of its own, which has loaded the solver.
Importing this package, or the client, loads no solver.
"""
