"""Sentences that have changed, and the proof that nothing else has."""
