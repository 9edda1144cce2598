"""Every set of faults: the plan for it, what it loses, and the smallest sets that lose a function."""
