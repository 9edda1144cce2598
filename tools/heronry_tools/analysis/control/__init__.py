"""Assessments of a component graph that need a solver: the longest cycle, and the least cut."""
