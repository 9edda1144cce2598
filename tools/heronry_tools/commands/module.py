"""`heronry module try`: runs the code of a module without a bus.

Exit codes: 0 every step has been computed; 1 the code fails, when it is imported, built, stepped, or asked for its
state; 2 the input cannot be used, for example because there is no such code.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout

from heronry_agent.core.vocabulary import StateLacking, StateSaved
from heronry_agent.shell.module_runner import Orders
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.runtime.module_trial import Trial, period_ns, read_value, requested_priorities, try_module
from heronry_wire.checkpoint_frames import frame_count


def run(arguments: argparse.Namespace) -> int:
    """Try a module; returns the exit code."""
    if arguments.steps < 1:
        raise UserError(f"--steps must be at least 1, not {arguments.steps}")
    if not 0 < arguments.rate_hz <= 10_000:
        raise UserError(f"--rate-hz must be above 0 and at most 10000, not {arguments.rate_hz:g}")
    inputs = {}
    for text in arguments.inputs:
        name, equals, value = text.partition("=")
        if not (name and equals):
            raise UserError(f"--inputs {text}: write it as NAME=VALUE, for example density=1.225")
        inputs[name] = read_value(value)
    reading = None if arguments.reading is None else read_value(arguments.reading)
    orders = Orders("module", arguments.image, arguments.mode, period_ns(arguments.rate_hz), device="NAME")
    with redirect_stdout(sys.stderr), Working(f"trying {arguments.image}"):
        trial = try_module(orders, inputs, reading, arguments.steps, arguments.limit)
    is_json = arguments.format == "json"
    for line in [json.dumps(trial.document(), indent=2)] if is_json else _report(trial, orders.period_ns):
        print(line)
    if trial.failure is not None and not is_json:
        when = f"in step {trial.failed_in}" if trial.failed_in else "before its first step"
        print(f"{trial.failure.traceback}heronry: the module failed {when}: {trial.failure.reason}", file=sys.stderr)
    return 0 if trial.failure is None and not isinstance(trial.state, StateLacking) and not trial.is_refused else 1


def _report(trial: Trial, period_ns: int) -> Iterator[str]:
    for number, step in enumerate(trial.steps, start=1):
        outputs = [f"{name}={value!r}" for name, value in step.outputs.items()]
        writes = [f"writes {value!r}" for value in step.writes]
        reports = [f"reports {element} failed, detail {detail}" for element, detail in step.reports]
        phases = [f"requests phase {phase}" for phase in step.phases]
        requests = [f"requests {_said(priority)} of {name}" for name, priority in requested_priorities(step)]
        yield f"step {number}: {', '.join([*outputs, *writes, *reports, *phases, *requests]) or 'gives nothing'}"
    if trial.steps:
        yield from _state(trial)
        yield f"longest step {trial.longest_ns / 1e6:.2f} ms, of a period of {period_ns / 1e6:g} ms"


def _state(trial: Trial) -> Iterator[str]:
    """Tell what became of `save` and `restore`, if the class has them."""
    match trial.state:  # None: the class has no `save`
        case StateLacking(_, lack, reason):
            yield f"state: cannot be saved ({lack.name}): {reason}"
        case StateSaved(data=b""):
            yield "state: none yet; save returns nothing after these steps"
        case StateSaved(data=data):
            size = f"{len(data)} bytes, {frame_count(len(data))} frames on a bus each time"
            yield f"state: {size}; in the spec: checkpoint: {{bytes: {len(data)}, hz: ..., max_age_ms: ...}}"
    if isinstance(trial.restored, StateLacking):
        yield f"state: cannot be restored ({trial.restored.lack.name}): {trial.restored.reason}"
    elif trial.restored is not None:
        yield "state: restored by a new object"


def _said(priority: int | None) -> str:
    return "the spec's priority" if priority is None else f"priority {priority}"
