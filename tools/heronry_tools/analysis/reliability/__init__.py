"""Reliability from the graph: minimal cut sets of every order, and exact probabilities."""
