"""Speed and quality of the planner, compared with other solvers on specs drawn from a seed."""
