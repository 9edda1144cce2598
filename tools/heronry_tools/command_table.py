"""The commands of `heronry`: name, purpose in one line, and the group in which the help shows each.

A command has an entry here, and two files of one name: in `command_lines/` its parsers, which are quick to import, and
in `commands/` what runs it, which may need all of heronry. Only this file imports either, when the user names the
command; all other imports stand at the heads of their files.

The groups are in the order in which a user needs them. A purpose has at most 62 characters, so that the list fits a
terminal of 80 columns. It says only what the command is for; `heronry COMMAND --help` teaches its use.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

HELP: Final = "help"  # the one command without a file


@dataclass(frozen=True, slots=True)
class Command:
    """One command: its name, its line in the help, and the name of its file in `command_lines/` and `commands/`."""

    name: str
    line: str
    file: str = ""

    def module(self) -> str:
        """Return the name of its two files: `file`, or if that is empty, the name of the command with `_` for `-`."""
        return self.file or self.name.replace("-", "_")


GROUPS: Final[Mapping[str, tuple[Command, ...]]] = {
    "start": (
        Command("demo", "watch an aircraft lose a computer and reconfigure"),
        Command(HELP, "this list, or what one command does: heronry help plan"),
    ),
    "write a spec": (
        Command("new", "write a project: spec, code, a driver, tests, units"),
        Command("check", "find what is wrong with specs, as a linter does"),
        Command("explain", "what one finding of 'check' means, and how to mend it", "rules"),
        Command("rules", "all rules of 'check'", "rules"),
        Command("schema", "the JSON schema of specs and graphs, for editors", "rules"),
        Command("render", "draw the dependency graph"),
        Command("diff", "what a change of a spec changes, and what follows from it"),
        Command("combine", "make one spec of two vehicles that share a radio"),
    ),
    "what if": (
        Command("plan", "the best configuration, whatever is down"),
        Command("verify", "is a plan legal, and which rules does it break?", "plan"),
        Command("why", "why a function is not served, and what would repair it"),
        Command("bus", "planned traffic: each message's worst case, each bus's load"),
        Command("bound", "the longest time that a reconfiguration takes"),
        Command("campaign", "what survives every set of faults"),
        Command("cutsets", "the smallest sets of faults that lose a function"),
        Command("export", "a function's fault tree for other tools of reliability", "openpsa"),
        Command("import", "a spec from a fault tree of another tool", "openpsa"),
        Command("pcs", "component graphs: what controls what, scripts that rewire it"),
    ),
    "try": (
        Command("module", "let the code of a module compute some steps, without a bus"),
        Command("sim", "fly in virtual time with drawn faults, and check each flight"),
        Command("fly", "land an aircraft of a flight dynamics model by its avionics"),
        Command("scenario", "fly a scenario file, and check what it expects"),
        Command("exhaust", "fly every fault at every message of every reconfiguration"),
    ),
    "deploy": (
        Command("contingencies", "make the plans for all faults ahead, for the manager"),
        Command("table", "compile the table from which a PE's agent runs"),
        Command("adopt", "write the lines of the spec for a node that it lacks"),
        Command("send-table", "send a table over the bus to a PE that waits for it"),
        Command("key", "make the key that proves the frames of manager and PEs"),
        Command("bundle", "make code into one signed file, and bring it to a PE"),
        Command("softbus", "a CAN bus in software, where the kernel has no vcan"),
        Command("doctor", "is this computer fit to fly, and what to type if not"),
        Command("preflight", "GO or NO GO: all that must hold before take-off"),
    ),
    "fly": (
        Command("manager", "run the system manager on a bus"),
        Command("phase", "the operator's order: enter another mission phase", "operator"),
        Command("priority", "the operator's order: another priority of a function", "operator"),
        Command("fail", "the operator's order: plan without an element", "operator"),
        Command("clear", "the operator's order: an element works again", "operator"),
        Command("retire", "the operator's order: what runs on an element moves first", "operator"),
        Command("restore", "the operator's order: a retired element is used again", "operator"),
        Command("reload", "change a flying aircraft to another spec"),
        Command("unlock", "the operator's order: CANopen tools may write to a PE", "operator"),
    ),
    "watch": (
        Command("web", "a page for a browser: graph, reconfigurations, what if"),
        Command("top", "watch a system: live, on a bus, or recorded"),
        Command("record", "record a flight: frames, events, spec, in rotating files"),
        Command("log", "convert a recorded flight for other tools: MCAP, MDF 4"),
        Command("metrics", "metrics for Prometheus"),
        Command("status", "what the manager on this computer knows", "operator"),
        Command("traceback", "the traceback of a module's last failure", "operator"),
        Command("replay", "run a recorded bus through the manager: why it decided so"),
        Command("dbc", "a DBC with which cantools decodes the bus"),
        Command("eds", "an EDS with which CANopen tools read a PE"),
    ),
}

COMMANDS: Final[Mapping[str, Command]] = {command.name: command for group in GROUPS.values() for command in group}


def add_parsers(command: Command, subparsers: Any) -> None:
    """Add the parsers of the command's file to `subparsers`: that of the command, and of those that share the file."""
    import_module(f"heronry_tools.command_lines.{command.module()}").add_parsers(subparsers)


def run_of(command: Command, arguments: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    """Import what runs a command, and give the function (arguments -> exit code) that `arguments.run` names.

    This is `run` where the parser names none.
    """
    name = getattr(arguments, "run", "run")
    run: Callable[[argparse.Namespace], int] = getattr(
        import_module(f"heronry_tools.commands.{command.module()}"), name
    )
    return run
