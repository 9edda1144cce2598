"""The tables of docs/: written by the code that they describe, so that they cannot say anything else."""
