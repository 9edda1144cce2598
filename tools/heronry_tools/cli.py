"""The command `heronry`: reads the command line, and runs the command that it names.

`command_table` lists the commands; `heronry --help` needs no other file. The command line of a command is read before
what runs it is imported, so that help and mistakes are told at once. With -o FILE, everything that a command prints
goes into FILE (`console.output`).

Exit codes of every command:

    0          the answer is yes, or the command has done what it should
    1          the answer is no: findings, a violation, a refusal
    2          the input cannot be used
    3          only of `heronry check`: a defect of heronry
    130, 143   ended by Ctrl-C; ended by SIGTERM
    141        the reader of the output has gone

An error that a user can correct is a `UserError`: one sentence on stderr.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence

from heronry_tools.command_table import COMMANDS, GROUPS, add_parsers, run_of
from heronry_tools.console.errors import UserError, exit_code
from heronry_tools.console.output import run_into_its_file, settled
from heronry_tools.console.progress import wish
from heronry_wire.command_parser import CommandParser, program_version
from heronry_wire.spelling import close, meant

_FIRST = """\
Graceful degradation for CAN-bus avionics: plan, deploy, observe and test.

usage: heronry COMMAND [ARGUMENTS]   heronry COMMAND --help   heronry --version
"""
_LAST = """\
A SPEC is a file (*.dg.yaml) or the name of a shipped one: big_blue,
elevator_and_chute. 'heronry COMMAND --help' teaches each command by example.
--json writes JSON for other programs; -o FILE writes the output into a file.
Exit codes: 0 yes or done; 1 no, or findings; 2 what was typed cannot be used.
"""


_CLOSE = 0.75  # least likeness to --help or --version; an option of a command, such as --json, must stay below it


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    argv = sys.argv[1:] if argv is None else argv
    return exit_code(lambda: _run(argv), "heronry", argv[0] if argv else None)


def _run(argv: Sequence[str]) -> int:
    match argv:
        case []:
            sys.stderr.write(help_of_all())
            return 2
        case ["-h" | "--help" | "help"] | ["help", "-h" | "--help" | "help"]:
            sys.stdout.write(help_of_all())
            return 0
        case ["--version" | "-V"]:
            print(f"heronry {program_version()}")
            return 0
        case ["help", *command]:
            return _run([*command, "--help"])
        case _:
            return _command(argv[0], argv)


def _command(name: str, argv: Sequence[str]) -> int:
    _expect_command(name)
    parser = CommandParser(prog="heronry")
    subparsers = parser.add_subparsers()
    add_parsers(COMMANDS[name], subparsers)
    arguments = settled(parser.parse_args(argv, argparse.Namespace(argv=tuple(argv))))
    wish(is_told=not getattr(arguments, "json", False))
    return run_into_its_file(run_of(COMMANDS[name], arguments), arguments)


def _expect_command(name: str) -> None:
    if name.startswith("-"):
        found = close(name, ("--help", "--version"), _CLOSE)
        remedy = f"did you mean {found}?" if found else f"the command comes first: heronry COMMAND {name}"
        raise UserError(f"{name} cannot stand before a command; {remedy}")
    if name not in COMMANDS:
        remedy = meant(name, COMMANDS, "'heronry --help' lists all commands")
        raise UserError(f"there is no command '{name}'; {remedy}")


def help_of_all() -> str:
    """Return the text of `heronry --help`: all commands, one line each, grouped by the task of the user."""
    return "\n".join([_FIRST, *_groups(), _LAST])


def _groups() -> Iterator[str]:
    width = max(map(len, COMMANDS))
    for title, commands in GROUPS.items():
        yield f"{title}:"
        yield "\n".join(f"  {command.name:<{width}}  {command.line}" for command in commands) + "\n"


if __name__ == "__main__":
    sys.exit(main())
