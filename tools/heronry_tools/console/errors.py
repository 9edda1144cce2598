"""Errors of the command line: a sentence with the place and the remedy, and never a traceback."""

import errno
import sys
from collections.abc import Callable
from contextlib import suppress
from io import StringIO
from typing import Final

from heronry_wire import interruption
from heronry_wire.errors import HeronryError

_EXTRAS: Final = {
    **dict.fromkeys(("canopen", "numpy", "ortools", "pydantic", "yaml"), "manager"),
    **dict.fromkeys(("starlette", "uvicorn"), "web"),
    **dict.fromkeys(("cantools", "rich", "textual"), "watch"),
    **dict.fromkeys(("asammdf", "mcap", "prometheus_client"), "export"),
    **dict.fromkeys(("cryptography", "packaging"), "bundle"),
    "distributed": "cluster",
    "highspy": "dev",
}
_SMALLER: Final = {
    **dict.fromkeys(("check", "explain", "rules", "schema"), "check"),
    "doctor": "doctor",
    **dict.fromkeys(("dbc", "record", "top"), "watch"),
    **dict.fromkeys(("log", "metrics"), "export"),
}
_ENOUGH: Final = {  # (package, command) -> a smaller extra, which brings the package for this command
    (module, command): extra for module in ("pydantic", "yaml") for command, extra in _SMALLER.items()
} | {("canopen", "doctor"): "doctor"}
_NO_MORE: Final = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
    errno.EBADF,  # standard output was closed by the caller
}  # error numbers of a failed write, if the error names no file


class UserError(HeronryError):
    """An error that the user can correct, such as a wrong name; the message is one sentence for stderr."""


def exit_code(program: Callable[[], int | None], name: str, command: str | None = None) -> int:
    """Run a program and return its exit code.

    An error that the user can correct gives a sentence on stderr and exit code 2. A closed pipe gives 141. A signal
    gives 128 + its number (Ctrl-C: 130), whatever else happened after the signal.
    """
    try:
        code = _flushed(program)
        interruption.expect_none()
    except KeyboardInterrupt:
        _drop_output()
        return interruption.came() or 130
    except BrokenPipeError:
        _drop_output()
        return 141
    except Exception as error:
        if interruption.came():  # an import that is interrupted may raise an ImportError instead
            return interruption.came()
        known = as_user_error(error, command)
        if known is None:
            raise
        _drop_output()
        with suppress(OSError):  # standard error may be a file on the same full disk
            print(f"{name}: {known}", file=sys.stderr)
        return 2
    return code


def _flushed(program: Callable[[], int | None]) -> int:
    """Run the program and flush standard output; returns the program's exit code, 0 for None.

    Because of the flush, output that cannot be written raises its error here, where it can still be reported.
    """
    try:
        return program() or 0
    finally:
        sys.stdout.flush()


def _drop_output() -> None:
    """Discard output that could not be written.

    Otherwise Python would try to write this output again when the process ends, and print an error of its own.
    """
    try:
        sys.stdout.flush()
    except OSError:
        sys.stdout = StringIO()


def as_user_error(error: Exception, command: str | None = None) -> str | None:
    """Return the sentence for an error that the user can correct; None for a defect of heronry.

    command: the command in which the error occurred; None: not known.
    """
    can = sys.modules.get("can")  # slow to import; a process that has not imported it has none of its errors
    if isinstance(error, HeronryError) or (can is not None and isinstance(error, can.CanError)):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        return _how_to_install(str(error.name).partition(".")[0], command)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError) and error.errno in _NO_MORE:
        return f"the output cannot be written: {error.strerror}; make room, or write elsewhere"
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return f"{error.strerror}: this process may open no more; allow more of them with 'ulimit -n'"
    return None


def _how_to_install(module: str, command: str | None) -> str | None:
    """Say how to install a missing package that an optional extra brings; None for any other package.

    command: the command that needs the package; for some commands a smaller extra is enough. None: not known.
    """
    extra = _ENOUGH.get((module, str(command))) or _EXTRAS.get(module)
    return f'{module} is not installed; add it with: pip install "heronry[{extra}]"' if extra else None
