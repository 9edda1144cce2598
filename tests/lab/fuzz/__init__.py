"""Arbitrary bytes for every decoder and arbitrary events for every core: none may raise."""
