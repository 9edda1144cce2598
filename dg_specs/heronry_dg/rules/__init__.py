"""What can be wrong with a spec, as data: one file per family of codes."""
