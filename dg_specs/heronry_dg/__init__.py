"""What may run: the spec language, its loader, and the verifier of configurations."""
