"""Compiles the simulator to machine code, for campaigns."""
