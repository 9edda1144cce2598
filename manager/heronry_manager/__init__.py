"""The planner, which finds configurations, and the system manager, which deploys them."""
