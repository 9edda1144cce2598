"""Fault trees in the Open-PSA Model Exchange Format: written from a function of a spec, and read into a spec."""
