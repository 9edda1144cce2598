"""Errors of the command line: a sentence with the place and the remedy, and never a traceback."""

import errno
import sys
from collections.abc import Callable
from io import StringIO
from typing import Final

from heronry_wire.errors import HeronryError

_EXTRAS: Final = {
    **dict.fromkeys(("canopen", "numpy", "ortools", "pydantic", "yaml"), "manager"),
    **dict.fromkeys(("cantools", "rich"), "watch"),
    "distributed": "cluster",
    "highspy": "dev",
}
_ENOUGH: Final = {  # a smaller extra has what these commands need
    (module, command): "check" for module in ("pydantic", "yaml") for command in ("check", "explain", "rules", "schema")
}
_NO_MORE: Final = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
}  # the error number of a failed write, which names no file


class UserError(HeronryError):
    """An error that the user can fix, as in what was typed; the message is one sentence for stderr."""


def exit_code(program: Callable[[], int | None], name: str, command: str | None = None) -> int:
    """Run a program; returns its exit code.

    2 stands for an error that the user can fix (one sentence on stderr), 130 for Ctrl-C, 141 for a closed pipe.
    """
    try:
        code = program() or 0
        sys.stdout.flush()  # here, where a failure can still be reported
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        _drop_output()
        return 141
    except Exception as error:
        known = as_user_error(error, command)
        if known is None:
            raise
        _drop_output()
        print(f"{name}: {known}", file=sys.stderr)
        return 2
    return code


def _drop_output() -> None:
    """Discard what could not be written; Python would try again when it ends, and print its own error."""
    try:
        sys.stdout.flush()
    except OSError:
        sys.stdout = StringIO()


def as_user_error(error: Exception, command: str | None = None) -> str | None:
    """Sentence for an error that the user can fix, raised by `command`; None for a defect of heronry."""
    can = sys.modules.get("can")  # slow to import; a process that has not imported it has none of its errors
    if isinstance(error, HeronryError) or (can is not None and isinstance(error, can.CanError)):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        return _how_to_install(str(error.name).partition(".")[0], command)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError) and error.errno in _NO_MORE:
        return f"the output cannot be written: {error.strerror}; make room, or write elsewhere"
    return None


def _how_to_install(module: str, command: str | None) -> str | None:
    """How to install a module that an optional extra brings; None for any other module."""
    extra = _ENOUGH.get((module, str(command))) or _EXTRAS.get(module)
    return f'{module} is not installed; add it with: pip install "heronry[{extra}]"' if extra else None
