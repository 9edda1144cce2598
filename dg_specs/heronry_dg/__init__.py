"""What may run: the spec language, its loader, and the judge of configurations."""
