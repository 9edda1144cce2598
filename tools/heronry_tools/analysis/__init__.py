"""Analyses of a spec that make many plans: check, campaigns of faults, why, differences, plans made ahead."""
