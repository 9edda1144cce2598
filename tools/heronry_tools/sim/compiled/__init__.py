"""Compiles the simulator to machine code, which makes campaigns of many flights faster."""
