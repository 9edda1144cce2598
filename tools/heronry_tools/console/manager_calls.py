"""Finds the manager that a command line names, and prints what this manager answers to an order."""

import argparse
import json
import sys
from pathlib import Path

from heronry_manager.core.vocabulary import UnlockPe
from heronry_manager.shell.control_client import call, find_socket
from heronry_manager.shell.control_protocol import Answer
from heronry_tools.console.errors import UserError


def manager_socket(arguments: argparse.Namespace) -> Path:
    """Return the socket of the manager to call.

    Raises ControlError in two cases: the manager that is named does not run; none is named, and the number of
    running managers is not one. A socket given by --socket is not checked.
    """
    return arguments.socket or find_socket(arguments.of)


def say_answer(arguments: argparse.Namespace, answer: Answer) -> int:
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


def unlock_pe(socket: Path | None, spec: str, pe: str) -> None:
    """Let the manager unlock a PE; raises UserError if the manager refuses."""
    answer = call(socket or find_socket(spec), UnlockPe(f"pe:{pe}"))
    if not answer.done:
        raise UserError(f"the manager does not unlock pe:{pe}: {answer.sentence}")
