"""The options --of NAME and --socket PATH, by which a command finds a manager.

Also prints what the manager answers to an order.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from heronry_tools.console.errors import UserError

if TYPE_CHECKING:
    from heronry_manager.shell.control_protocol import Answer


def add_manager_argument(parser: argparse.ArgumentParser) -> None:
    """Add the options --of and --socket, of which a user gives at most one to say which manager to call."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--of",
        metavar="NAME",
        help="the manager to call: the name of its spec; for a demo, NAME-demo (default: the only manager)",
    )
    which.add_argument(
        "--socket", type=Path, metavar="PATH", help="the manager's socket, if the manager was started with --socket"
    )


def manager_socket(arguments: argparse.Namespace) -> Path:
    """Give the socket of the manager to call.

    Raises ControlError in two cases: the manager that is named does not run; none is named, and the number of
    running managers is not one. A socket given by --socket is not checked.
    """
    from heronry_manager.shell.control_client import find_socket  # noqa: PLC0415 - keeps other commands quick

    return arguments.socket or find_socket(arguments.of)


def say_answer(arguments: argparse.Namespace, answer: "Answer") -> int:
    """Print what a manager answered to an order; returns the exit code: 0 if the order is carried out, 1 if not.

    Raises UserError if the manager could not read the order, or if the order names an element, function or
    phase that the spec does not have.
    """
    if answer.is_unusable:
        raise UserError(answer.sentence)
    if arguments.json:
        print(json.dumps({"done": answer.done, "sentence": answer.sentence}))
    elif answer.done:
        print(answer.sentence)
    else:
        print(f"heronry: {answer.sentence}", file=sys.stderr)
    return 0 if answer.done else 1
