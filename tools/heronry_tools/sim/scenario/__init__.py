"""Scenario files (what happens to an aircraft, and which frames are expected), their flights, and golden traces.

A golden trace has what the manager decided in a flight of the scenario.
"""
