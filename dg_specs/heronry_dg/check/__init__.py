"""Judging specs like code: what is looked for beyond loading, what is suppressed, and how findings are told."""
