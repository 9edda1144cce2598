"""The laboratory: what tests heronry itself, and is never shipped."""
