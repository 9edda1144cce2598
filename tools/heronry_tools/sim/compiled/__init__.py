"""The simulator as machine code, for campaigns."""
