"""The demo: runs a manager and every PE as one process each, on a real bus, and says in sentences what happens."""

DEFAULT_SECONDS = 15.0
LONGEST_SECONDS = 1_000_000.0  # a demo with a page goes on until it is interrupted
