"""Replays a recorded bus through the manager's core, which takes the same decisions and gives the reason for each."""
