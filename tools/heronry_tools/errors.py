"""Errors of the command line: a sentence with the place and the remedy, and never a traceback."""

import sys
from typing import Final

from heronry_wire.errors import HeronryError

_EXTRAS: Final = {"pydantic": "check", "yaml": "check", "ortools": "manager", "rich": "watch", "cantools": "watch"}


class UserError(HeronryError):
    """Something wrong with what the user typed; the message is one sentence for stderr."""


def as_user_error(error: Exception) -> str | None:
    """Sentence for an error that a user can mend; None for a defect of ours."""
    can = sys.modules.get("can")  # slow to import; who has not imported it has none of its errors
    if isinstance(error, HeronryError) or (can is not None and isinstance(error, can.CanError)):
        return str(error)
    if isinstance(error, ModuleNotFoundError) and error.name in _EXTRAS:
        return f"{error.name} is not installed; install heronry[{_EXTRAS[error.name]}]"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None
