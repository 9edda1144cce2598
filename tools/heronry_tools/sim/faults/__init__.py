"""The faults that a flight can have: their notation, how a seed draws them, and an attacker that forges frames."""
