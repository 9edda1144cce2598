"""The demo: a manager and every PE as processes of their own on a real bus, with their events as sentences."""

DEFAULT_SECONDS = 15.0
LONGEST_SECONDS = 1_000_000.0  # a demo with a page goes on until it is interrupted
