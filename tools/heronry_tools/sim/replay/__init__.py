"""Replays a recorded bus through the manager's core, which takes the same decisions again and gives its reasons."""
