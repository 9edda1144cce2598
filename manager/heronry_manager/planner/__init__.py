"""The exact planner: the best legal configuration for any situation, with proof.

`exact.plan` plans in this process, `client.PlannerClient` in a warm one of its own. Importing this package, or the
client, loads no solver.
"""
