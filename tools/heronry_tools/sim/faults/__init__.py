"""The faults of a flight: how they are written, how a seed draws them, and an attacker that forges frames."""
