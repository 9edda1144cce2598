"""`heronry new`: writes a project that works at once, and says what to type next."""

import argparse
import json
import shlex
import shutil
import sys
from pathlib import Path

from heronry_tools.runtime.new_project.project import write_project


def run(arguments: argparse.Namespace) -> int:
    """Write the project; returns the exit code."""
    name, parent = arguments.name, arguments.parent
    files = write_project(name, parent)
    commands = next_commands(name, parent / name)
    if arguments.json:
        print(json.dumps({"folder": str(parent / name), "files": [str(one) for one in files], "commands": commands}))
        return 0
    for one in files:
        print(one)
    print("\nCheck it, fly it, test it:\n")
    for command in commands:
        print(f"  {command}")
    return 0


def next_commands(name: str, folder: Path) -> list[str]:
    """Return the commands that check, fly and test a project, each for a shell in the present folder."""
    change, python = f"cd {shlex.quote(str(folder))} && ", _program("python")
    heronry = _program("heronry", "-m heronry_tools")
    return [
        f"{change}{heronry} check {name}.dg.yaml",
        f"{change}{heronry} demo {name}.dg.yaml --for 10",
        f"{change}{python} -m unittest",
    ]


def _program(name: str, module: str = "") -> str:
    """Return what to type for a program of this environment: its name, if that finds it, or its path.

    module: what to type behind the path of Python where the environment has no such program.
    """
    own = Path(sys.executable).with_name(name)
    found = shutil.which(name)
    if found is not None and Path(found) == own:
        return name
    return shlex.quote(str(own)) if own.exists() else f"{shlex.quote(sys.executable)} {module}".rstrip()
