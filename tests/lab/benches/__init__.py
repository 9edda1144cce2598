"""How fast and how steady: one bench a file, one harness."""
