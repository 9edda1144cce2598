"""What needs a solver to assess a component graph: the longest cycle, and the least cut."""
