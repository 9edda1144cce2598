"""The command line of `heronry reload`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.manager_argument import add_manager_argument
from heronry_tools.console.output import add_json

_EPILOG = """\
The manager that runs here is given SPEC. It brings each PE its new table beside the old one, and one epoch changes all
of them, or none. A module whose definition is the same goes on without a missed step. If anything fails before the
change, the old spec flies on. PEs take a table in flight if their agents were started with --node.

A standby manager on this computer is given SPEC first, and follows when the aircraft changes. For one on another
computer, give the command there first, with --standby. A standby manager that lacks the spec that flies does not take
over.

examples:
  heronry reload my.dg.yaml            show what changes, ask, and fly by it
  heronry reload my.dg.yaml --yes      ... without a question
  heronry reload --watch my.dg.yaml    each save that passes 'heronry check' flies, until Ctrl-C
  heronry reload --back                fly by the spec before
  heronry reload my.dg.yaml --standby  on the computer of the standby manager: it has the spec at hand from now on
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry reload`."""
    parser = subparsers.add_parser(
        "reload", description="Change a flying aircraft to another spec, without a landing.", epilog=_EPILOG
    )
    parser.add_argument("spec", nargs="?", metavar="SPEC", help="the *.dg.yaml by which to fly")
    parser.add_argument("-y", "--yes", action="store_true", help="do not ask; --json does not, either")
    parser.add_argument("--back", action="store_true", help="fly by the spec that flew before the last reload")
    parser.add_argument("--watch", action="store_true", help="reload at each save of SPEC")
    parser.add_argument("--standby", action="store_true", help="give the spec only to the standby manager here")
    parser.add_argument(
        "--without-standby", action="store_true", help="although the standby manager here does not take the spec"
    )
    add_manager_argument(parser)
    add_json(parser)
