"""The demo: a manager and every PE as processes of their own on a real bus, and the story of what happens to them."""

DEFAULT_SECONDS = 15.0
