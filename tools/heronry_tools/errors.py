"""Errors of the command line: a sentence with the place and the remedy, and never a traceback."""

import sys
from collections.abc import Callable
from typing import Final

from heronry_wire.errors import HeronryError

_EXTRAS: Final = {
    **dict.fromkeys(("numpy", "ortools", "pydantic", "yaml"), "manager"),
    **dict.fromkeys(("cantools", "rich"), "watch"),
    "distributed": "cluster",
    "highspy": "dev",
}
_ENOUGH: Final = {  # a smaller extra has what these commands need
    (module, command): "check" for module in ("pydantic", "yaml") for command in ("check", "explain", "rules", "schema")
}


class UserError(HeronryError):
    """Something wrong with what the user typed; the message is one sentence for stderr."""


def exit_code(program: Callable[[], int | None], name: str, command: str | None = None) -> int:
    """Run a program; whatever a user can mend becomes a sentence on stderr and 2, Ctrl-C 130, a closed pipe 141."""
    try:
        return program() or 0
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        return 141
    except Exception as error:
        known = as_user_error(error, command)
        if known is None:
            raise
        print(f"{name}: {known}", file=sys.stderr)
        return 2


def as_user_error(error: Exception, command: str | None = None) -> str | None:
    """Sentence for an error that a user can mend, met by a command; None for a defect of ours."""
    can = sys.modules.get("can")  # slow to import; who has not imported it has none of its errors
    if isinstance(error, HeronryError) or (can is not None and isinstance(error, can.CanError)):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        return _how_to_install(str(error.name).partition(".")[0], command)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None


def _how_to_install(module: str, command: str | None) -> str | None:
    """What a node does without comes with an extra; None where it does not."""
    extra = _ENOUGH.get((module, str(command))) or _EXTRAS.get(module)
    return f'{module} is not installed; add it with: pip install "heronry[{extra}]"' if extra else None
