"""What the package canopen logs, kept off the terminal.

canopen logs a transfer that fails, and raises an error too. Python prints a log that nobody handles to standard error,
where the user then reads a line without a place or a remedy beside the sentence of the command.
"""

import logging
from typing import Final

_DROPPED: Final = logging.NullHandler()


def keep_off_the_terminal() -> None:
    """Drop what canopen logs, unless the program has a log of its own. A second call changes nothing."""
    logging.getLogger("canopen").addHandler(_DROPPED)
