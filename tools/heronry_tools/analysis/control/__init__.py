"""What needs a solver to judge a component graph: the longest cycle, and the least cut."""
