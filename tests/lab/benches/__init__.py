"""Benchmarks of speed and steadiness: one per file (`python -m lab.benches.NAME`), and one harness."""
