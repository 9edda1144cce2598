"""`heronry preflight`: all that must hold before take-off, in one list, with what to type where it does not.

Exit codes: 0 go, 1 no go, 2 it cannot be judged: no manager answers, or what was typed cannot be used.
"""

import argparse
import time
from collections.abc import Callable

from heronry_manager.shell.control_place import ControlError
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import manager_socket
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.preflight.inspection import Inspection
from heronry_tools.reports.findings import Finding, all_right, as_json, as_text
from heronry_tools.sources.opened import named_choices
from heronry_wire.key_file import read_key

_PAUSE_S = 0.5


def run(arguments: argparse.Namespace) -> int:
    """Inspect and report; returns 0 for GO, 1 for NO GO."""
    if not 0 < arguments.seconds <= 600:
        raise UserError(f"--seconds {arguments.seconds:g}: listen for more than 0 and up to 600 s")
    spec = load_spec(arguments.spec)
    key = None if arguments.key is None else read_key(arguments.key)
    buses = list(named_choices(spec, arguments))

    def inspected() -> list[Finding]:
        socket = manager_socket(arguments)
        return Inspection(spec, arguments.spec, socket, buses, arguments.seconds, key).findings()

    with Working(f"inspecting {spec.name}"):
        findings = _as_soon_as_right(inspected, time.monotonic() + arguments.wait)
    print(as_json(findings) if arguments.json else "\n".join(as_text(findings, "GO", "NO GO: ")))
    return 0 if all_right(findings) else 1


def _as_soon_as_right(inspected: Callable[[], list[Finding]], until_s: float) -> list[Finding]:
    """Inspect until everything is right, or until a time of the monotonic clock; gives the last findings.

    Raises ControlError if no manager answers by then.
    """
    while True:
        is_over = time.monotonic() >= until_s
        try:
            findings = inspected()
        except ControlError:
            if is_over:
                raise
        else:
            if is_over or all_right(findings):
                return findings
        time.sleep(_PAUSE_S)
