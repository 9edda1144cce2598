"""The EAV's images closed around its plant, without bus, agents and plans: to see what the laws alone can do."""
