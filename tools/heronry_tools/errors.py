"""Errors of the command line: a sentence with the place and the remedy, and never a traceback."""

import can

from heronry_dg.findings import SpecError
from heronry_dg.plan import PlanError
from heronry_dg.situation import UnknownElementError


class UserError(Exception):
    """Something the user can mend; the message is one sentence for stderr."""


def as_user_error(error: Exception) -> str | None:
    """Sentence for an error of the rooms below that a user can mend; None for a defect of ours."""
    if isinstance(error, (SpecError, PlanError, UnknownElementError, can.CanError)):
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None
