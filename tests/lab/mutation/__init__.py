"""Defects put into the flight code on purpose, to see whether the tests would notice."""
