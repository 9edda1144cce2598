"""The laboratory: programs that test heronry itself, and are never shipped."""
