"""Reads scenario files, flies them, and compares the flights with golden traces.

A scenario file says what happens to an aircraft, and which frames are expected. A golden trace is another file: it says
what the manager decided in an earlier flight of the scenario.
"""
