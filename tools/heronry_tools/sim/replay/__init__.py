"""A recorded bus, put through the manager's core again: the same decisions, each with its reason."""
