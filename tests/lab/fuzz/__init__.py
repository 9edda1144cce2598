"""Bytes of any kind, for everything that reads bytes and every core that takes events: nothing may raise."""
