"""The agent of a processing element (PE)."""
