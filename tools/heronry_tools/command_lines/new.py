"""The command line of `heronry new`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_json

_EPILOG = """\
examples:
  heronry new glider                             the folder glider, with all that a first node needs
  heronry new glider --in projects               ... in another place
  heronry new glider --json                      its files and commands, for scripts

It writes a spec of two computers, the code of three modules, a driver, tests, a workflow for CI, and units of systemd.
All of it works at once; change it from there. The answer has the commands that check, fly and test it.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry new`."""
    parser = subparsers.add_parser(
        "new", description="Write a project of your own: spec, code, driver, tests, units.", epilog=_EPILOG
    )
    parser.add_argument("name", metavar="NAME", help="name of the project, its folder, its spec and its Python package")
    parser.add_argument(
        "--in", dest="parent", metavar="DIR", type=Path, default=Path(), help="folder of the new folder (default: here)"
    )
    add_json(parser, "write files and commands as JSON")
