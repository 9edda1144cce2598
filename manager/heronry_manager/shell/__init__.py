"""The part of the manager with input and output: the loop, the operator's socket, the journal on disk."""
