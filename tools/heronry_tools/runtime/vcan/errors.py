"""The one exception of this package: something outside this program is not as needed."""


class CannotRunError(Exception):
    """The command could not be run at all; the message is one sentence that says why and what to do."""
