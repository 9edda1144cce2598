"""Gives a reconfiguration script (`heronry_pcs`) to a running manager, and waits for the result.

The manager answers as soon as it has understood the script. Then it requests the best plan, and compares this
plan with the configuration of the script. It deploys the configuration of the script, or refuses the script:
for example, if the configuration of the script is worse than the best plan at level 1 (critical functions).
The status of the manager shows the progress.
"""

import time
from pathlib import Path
from typing import Any, Final

from heronry_dg.model import Spec
from heronry_manager.core.epochs import Stage
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_protocol import Answer, FlyScript
from heronry_tools.console.errors import UserError

PATIENCE_S: Final = 30.0  # the exact planner has no limit of time
_LOOK_S = 0.1  # with each look the manager reads from the PEs, too


def fly(path: Path, text: str, spec: Spec) -> Answer:
    """Give a script to a manager, and return success or failure with a sentence.

    path: the socket of the manager.
    text: the script.
    spec: the spec for which the script is written.
    Raises ControlError if no manager answers, and UserError if the manager has another spec than `spec`.
    """
    flies = dict(call(path, AskStatus()).status or {})
    if flies["spec_digest"] != spec.digest:
        if flies["spec"] == spec.name:
            raise UserError(
                f"the manager on {path} flies another version of {spec.name}: name that version as SPEC, or restart "
                "the manager with yours"
            )
        raise UserError(
            f"the manager on {path} flies another spec, {flies['spec']}: name the manager of {spec.name} with --of NAME"
        )
    answer = call(path, FlyScript(text))
    until_s = time.monotonic() + PATIENCE_S
    while answer.done and time.monotonic() < until_s:
        status = dict(call(path, AskStatus()).status or {})
        told = _outcome(status)
        if told is not None:
            return told
        time.sleep(_LOOK_S)
    if not answer.done:
        return answer
    late = f"the script has not been completed within {PATIENCE_S:.0f} s; it may still be running"
    return Answer(done=False, sentence=f"{late}: see 'heronry status'")


def _outcome(status: dict[str, Any]) -> Answer | None:
    """Return the result of the last script; None while the manager is still working on the script."""
    script = status["script"]
    match script["state"]:
        case "held" if status["next"] is None and status["stage"] == Stage.DONE.value:
            sentence = f"the script runs in epoch {status['epoch']}, and is held until 'heronry pcs release'"
            return Answer(done=True, sentence=sentence)
        case "asked" | "held":
            return None
        case "none":
            sentence = "the manager knows no script: it was restarted, or another one took over; see 'heronry status'"
            return Answer(done=False, sentence=sentence)
        case state:
            verb = "was refused, and nothing has changed" if state == "refused" else "is held no longer"
            return Answer(done=False, sentence=f"the script {verb}: {script['why']}")
