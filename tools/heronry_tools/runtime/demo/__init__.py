"""The demo: runs a manager and every PE as one process each, on a real bus, and says in sentences what happens."""
