"""Every fault there could be: what is planned for it, what it costs, and what it takes to lose a function."""
