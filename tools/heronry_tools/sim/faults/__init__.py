"""The faults that a flight can have: their notation, how a seed draws them, and who forges frames."""
