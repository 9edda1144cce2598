"""Deliberate defects in the flight code, which show whether the tests would notice such a defect."""
