"""The tables of docs/: generated from the code that they describe, so that both agree."""
