"""The longest time that a reconfiguration can take, computed before a flight."""
