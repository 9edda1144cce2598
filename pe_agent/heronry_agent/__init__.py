"""Does: the agent of a processing element."""
