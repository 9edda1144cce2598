"""The exception that `with-vcan` reports to its user: something outside the program keeps the command from running."""


class CannotRunError(Exception):
    """The command could not be run at all; the message is one sentence that says why and what to do."""
