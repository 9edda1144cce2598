"""All of the manager that touches the world: the loop, the operator's socket, the journal on disk."""
