"""How fast and how steady: one bench a file (`python -m lab.benches.NAME`), and one harness."""
