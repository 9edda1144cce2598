"""Watching a system: one snapshot of everything that is known, its feeds, and what is shown or written of it."""
