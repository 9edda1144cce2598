"""Analyses of a spec: checks, fault campaigns, why a function is not served, differences, contingencies made ahead."""
