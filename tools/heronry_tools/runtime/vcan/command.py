"""Finds and describes the command that the user wants to run, before anything is started."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from heronry_tools.runtime.vcan.errors import CannotRunError


class ExpiredError(Exception):
    """The command has not ended within its time limit."""


class NotFoundError(CannotRunError):
    """The command that the user named does not exist, or is not executable."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command line, with the folder and the environment in which it runs."""

    executable: str  # absolute
    argv: list[str]  # argv[0] as the user wrote it
    env: dict[str, str]
    cwd: str


def described(argv: list[str], tools: Path | None) -> Command:
    """Describe the command `argv`, to be run in the present folder.

    tools: a folder with programs, which becomes the last one on the PATH of the command; None: no such folder.
    """
    env = dict(os.environ)
    if tools is not None:
        env["PATH"] = os.pathsep.join(filter(None, (env.get("PATH", os.defpath), str(tools))))
    try:
        cwd = str(Path.cwd())
    except FileNotFoundError:
        raise CannotRunError("the folder you are in no longer exists: change into another") from None
    executable = shutil.which(argv[0], path=env.get("PATH", os.defpath))
    if executable is None:
        raise NotFoundError(f"{argv[0]} was not found, or is not executable")
    return Command(os.path.abspath(executable), argv, env, cwd)  # noqa: PTH100 - resolve() would leave a virtual environment
