"""The command `heronry`: one parser, one file per command, and nothing slow is imported before it is needed.

A command file has `add_parsers(subparsers)`, which sets `run` (arguments -> exit code) on each of its parsers. A new
command also needs its line in COMMANDS, and in the examples of `heronry --help` (`_EPILOG`) where it helps. Errors that
a user can fix are `UserError`: one sentence on stderr, exit code 2. Ctrl-C ends with 130.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Final

from heronry_tools.console.errors import exit_code

COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {  # file -> the commands that it adds
    "plan": ("plan", "verify"),
    "demo": ("demo",),
    "manager": ("manager",),
    "operator": ("status", "phase", "fail", "clear", "unlock"),
    "key": ("key",),
    "table": ("table",),
    "send_table": ("send-table",),
    "doctor": ("doctor",),
    "sim": ("sim",),
    "exhaust": ("exhaust",),
    "scenario": ("scenario",),
    "replay": ("replay",),
    "dbc": ("dbc",),
    "eds": ("eds",),
    "check": ("check",),
    "rules": ("rules", "explain", "schema"),
    "render": ("render",),
    "diff": ("diff",),
    "bus": ("bus",),
    "bound": ("bound",),
    "contingencies": ("contingencies",),
    "campaign": ("campaign",),
    "cutsets": ("cutsets",),
    "why": ("why",),
}

_EPILOG = """\
examples:
  heronry demo                                   the whole system on a software bus: a kill, and what follows
  heronry plan big_blue --down pe:flight         the best configuration without the flight computer
  heronry plan big_blue --json >plan.json        ... as JSON
  heronry verify big_blue plan.json              is that plan legal?
  heronry bus big_blue                           every message on its buses, with its worst case
  heronry bound big_blue                         how long a reconfiguration takes at most
  heronry campaign big_blue --faults 1           what survives any single fault
  heronry cutsets big_blue elevator              the smallest fault sets that lose a function
  heronry why big_blue guidance --down device:gps --phase glide
  heronry contingencies big_blue -o big_blue.contingencies      plans for all faults, made ahead for the manager
  heronry manager my.dg.yaml -i socketcan -c can0
  heronry key fleet.key                          a key: a node without it cannot command
  heronry status                                 what the manager here knows; phase, fail, clear give orders to it
  heronry doctor -i socketcan -c can0            is this node fit to fly, and what to type where it is not
  heronry sim big_blue --runs 100                a hundred flights in virtual time, each with other faults
  heronry exhaust my.dg.yaml --sample 100        lose, double, delay any message of its reconfigurations
  heronry scenario kill.scenario                 a text file: what happens, and what is expected then
  heronry replay flight.log big_blue             a recording run through the manager again: why it decided so
  heronry dbc big_blue >big_blue.dbc             read the bus with cantools
  heronry eds -o heronry_pe.eds                  read a PE with CANopen tools
  heronry check my.dg.yaml                       its errors and warnings, for editors, hooks and CI
  heronry render big_blue -o big_blue.svg        its dependency graph as a picture
  heronry diff big_blue my.dg.yaml               what changed, and what follows from it

A SPEC is a file (*.dg.yaml) or the name of a shipped one: big_blue, elevator_and_chute.
'heronry COMMAND --help' teaches each command by example.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    argv = sys.argv[1:] if argv is None else argv
    return exit_code(lambda: _run(argv), "heronry", argv[0] if argv else None)


def _run(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="heronry",
        description="Graceful degradation for CAN-bus avionics: plan, deploy, observe and test.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in _files_for(argv):
        import_module(f"heronry_tools.commands.{name}").add_parsers(subparsers)
    arguments = parser.parse_args(argv, argparse.Namespace(argv=tuple(argv)))
    code: int = arguments.run(arguments)
    return code


def _files_for(argv: Sequence[str]) -> list[str]:
    """Give the command files whose parsers are needed: that of the given command, or all, as for --help."""
    return [name for name, commands in COMMANDS.items() if argv and argv[0] in commands] or list(COMMANDS)


if __name__ == "__main__":
    sys.exit(main())
