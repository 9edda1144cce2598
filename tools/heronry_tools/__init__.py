"""Watches and tries: command line, software bus, simulator, demo."""
