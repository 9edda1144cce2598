"""`heronry module try`: runs the code of a module without a bus.

Exit codes: 0 every step has been computed; 1 the code fails, when it is imported, built or stepped; 2 the input cannot
be used, for example because there is no such code.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

from heronry_tools.console.output import add_output

if TYPE_CHECKING:
    from heronry_tools.runtime.module_trial import Trial

_LONGEST_S = 86_400
_EPILOG = """\
examples:
  heronry module try my_glider:Speed --reading 3.2 --inputs density=1.225    three steps, and what each one gives
  heronry module try my_glider:Speed --mode fast --rate-hz 40 --steps 100    ... in another mode
  heronry module try my_glider:Speed                                         no input, and a device that is silent
  heronry module try state_estimator                                         code that is installed under a short name
  heronry module try my_glider:Speed --reading 3.2 --json | jq .steps[-1].outputs

IMAGE is what the spec names as 'image': my_glider:Speed is class Speed in my_glider.py, here or where Python finds it.
A value is a whole number (1), a number (1.5), whole numbers with commas between (1,2), or else a text. Every step gets
the same inputs and the same reading, one period after the step before. What the module prints goes to standard error.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry module`."""
    parser = subparsers.add_parser("module", description="Try the code of a module without a bus.", epilog=_EPILOG)
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    trial = actions.add_parser(
        "try",
        help="build a module and let it compute some steps",
        description="Build a module and let it compute some steps, without a bus, a spec or an agent.",
        epilog=_EPILOG,
    )
    trial.add_argument("image", metavar="IMAGE", help="package.module:Class, or a name of an installed catalogue")
    trial.add_argument(
        "--inputs", metavar="NAME=VALUE", nargs="+", default=[], help="variables that the module gets in each step"
    )
    trial.add_argument(
        "--reading", metavar="VALUE", help="reading of the module's device (default: the device does not answer)"
    )
    trial.add_argument("--mode", metavar="NAME", default="only", help="name of the module's mode (default: 'only')")
    trial.add_argument("--rate-hz", metavar="HZ", type=float, default=10.0, help="steps in a second (default 10)")
    trial.add_argument("--steps", metavar="N", type=int, default=3, help="number of steps to compute (default 3)")
    trial.add_argument(
        "--limit",
        metavar="SECONDS",
        type=_limit,
        default=10.0,
        help="seconds after which the module's code counts as failed if it has not ended (default 10)",
    )
    add_output(trial, "print steps and failure as one JSON object")
    trial.set_defaults(run=run)


def _limit(text: str) -> float:
    """Read a limit in seconds; raises ArgumentTypeError with a sentence for the user."""
    try:
        limit_s = float(text)
    except ValueError:
        limit_s = 0.0
    if not 0 < limit_s <= _LONGEST_S:
        raise argparse.ArgumentTypeError(
            f"{text} cannot be the limit; write a number of seconds, more than 0 and at most {_LONGEST_S}"
        )
    return limit_s


def run(arguments: argparse.Namespace) -> int:
    """Try a module; returns the exit code."""
    from heronry_agent.shell.module_runner import Orders  # noqa: PLC0415 - keeps `--help` quick
    from heronry_tools.console.errors import UserError  # noqa: PLC0415
    from heronry_tools.runtime.module_trial import period_ns, read_value, try_module  # noqa: PLC0415

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
    with redirect_stdout(sys.stderr):
        trial = try_module(orders, inputs, reading, arguments.steps, arguments.limit)
    is_json = arguments.format == "json"
    for line in [json.dumps(trial.document(), indent=2)] if is_json else _report(trial, orders.period_ns):
        print(line)
    if trial.failure is not None and not is_json:
        when = f"in step {trial.failed_in}" if trial.failed_in else "before its first step"
        print(f"{trial.failure.traceback}heronry: the module failed {when}: {trial.failure.reason}", file=sys.stderr)
    return 0 if trial.failure is None else 1


def _report(trial: "Trial", period_ns: int) -> Iterator[str]:
    from heronry_tools.runtime.module_trial import requested_priorities  # noqa: PLC0415

    for number, step in enumerate(trial.steps, start=1):
        outputs = [f"{name}={value!r}" for name, value in step.outputs.items()]
        writes = [f"writes {value!r}" for value in step.writes]
        reports = [f"reports {element} failed, detail {detail}" for element, detail in step.reports]
        phases = [f"requests phase {phase}" for phase in step.phases]
        requests = [f"requests {_said(priority)} of {name}" for name, priority in requested_priorities(step)]
        yield f"step {number}: {', '.join([*outputs, *writes, *reports, *phases, *requests]) or 'gives nothing'}"
    if trial.steps:
        yield f"longest step {trial.longest_ns / 1e6:.2f} ms, of a period of {period_ns / 1e6:g} ms"


def _said(priority: int | None) -> str:
    return "the spec's priority" if priority is None else f"priority {priority}"
