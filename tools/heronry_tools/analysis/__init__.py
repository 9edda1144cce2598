"""Analyses of a spec that take many plans: check, campaigns of faults, why, differences, plans made ahead."""
