"""Checking specs as a linter checks code: the checks beyond loading, suppressed findings, and reports."""
