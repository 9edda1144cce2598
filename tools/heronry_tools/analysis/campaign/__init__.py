"""Campaigns: the plan for every set of faults, what each set loses, and the smallest sets that lose a function."""
