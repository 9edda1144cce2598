"""The part of the manager that has input and output: the loop, the operator's socket, the journal on disk."""
