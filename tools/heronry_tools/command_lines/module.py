"""The command line of `heronry module try`: arguments, their help, and examples."""

import argparse
from typing import Any

from heronry_tools.console.output import add_output

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
