"""How long a reconfiguration takes at most, computed before a flight."""
