"""`heronry status`, `traceback`, `phase`, `priority`, `fail`, `retire`, `unlock` ...: orders to a local manager."""

import argparse
import json

from heronry_manager.core.vocabulary import AskStatus, SetPriority
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_protocol import WITH_WHAT, Spoken
from heronry_tools.console.manager_calls import manager_socket, say_answer
from heronry_tools.console.progress import Working
from heronry_tools.reports.status import report
from heronry_tools.reports.troubles import troubles


def run(arguments: argparse.Namespace) -> int:
    """Send the command's order to the manager and print the answer; returns 0 if it was carried out, 1 if refused."""
    path = manager_socket(arguments)
    if arguments.order == "status":
        with Working("asking the manager"):
            status = call(path, AskStatus()).status or {}
        print(json.dumps(status, indent=2) if arguments.json else "\n".join(report(status)))
        return 1 if arguments.exit_code and any(troubles(status)) else 0
    if arguments.order == "priority":
        order: Spoken = SetPriority(arguments.what, None if arguments.to == "default" else arguments.to)
    else:
        order = WITH_WHAT[arguments.order](arguments.what)
    with Working("asking the manager"):  # a traceback comes over the bus
        answer = call(path, order)
    return say_answer(arguments, answer)
