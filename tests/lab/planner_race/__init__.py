"""How fast and how good the planner is, against others, on specs drawn by a seed."""
