"""The one exception of this package, for a condition outside this program that keeps the command from running."""


class CannotRunError(Exception):
    """The command could not be run at all; the message is one sentence that says why and what to do."""
