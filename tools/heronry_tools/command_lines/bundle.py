"""The command line of `heronry bundle`: arguments, their help, and examples."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_json
from heronry_tools.console.spec_argument import add_spec_argument
from heronry_wire.bus_arguments import add_bus_arguments

_EPILOG = """\
examples:
  heronry key --signing fleet.signing                            once: a key that signs code, and its public half
  heronry bundle build my_code nav.bundle --name nav --version 3 --image my_estimator:Estimator
  heronry bundle sign nav.bundle --key fleet.signing             in its place
  heronry bundle inspect nav.bundle --key fleet.signing.pub      what is in it, and is it whole and signed?
  heronry bundle send nav.bundle my.dg.yaml nav -i socketcan -c can0       bring it to a PE, and start it there

A PE takes a bundle over the bus only if it was started with --code-dir, and only a higher version than before.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of `heronry bundle` and of its commands."""
    parser = subparsers.add_parser(
        "bundle", description="Make the code of images into one file that a PE takes over the bus.", epilog=_EPILOG
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_build(commands)
    sign = _command(commands, "sign", "sign a bundle, in its place")
    _add_bundle(sign)
    sign.add_argument(
        "--key", type=Path, metavar="FILE", required=True, help="the signing key of 'heronry key --signing'"
    )
    inspect = _command(commands, "inspect", "tell what is in a bundle, and check it")
    _add_bundle(inspect)
    inspect.add_argument("--key", type=Path, metavar="FILE", help="check its signature by this public key, too")
    send = _command(commands, "send", "bring a bundle to a PE at rest over the bus, and start it there")
    _add_bundle(send)
    add_spec_argument(send)
    send.add_argument("pe", metavar="PE", help="name of the PE")
    send.add_argument("--no-start", action="store_true", help="let the bundle wait on the PE until it is sent again")
    send.add_argument(
        "--socket", type=Path, metavar="PATH", help="the manager's socket; where PEs have a key, it unlocks the PE"
    )
    send.add_argument("--unlock", action="store_true", help="the PE has a key: let this computer's manager unlock it")
    add_bus_arguments(send, "the PE's uplink, or the manager's bus; a tenth of the slowest bus on the way is used")


def _command(commands: Any, name: str, does: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.")
    add_json(parser, "write what is told as JSON")
    parser.set_defaults(run=f"run_{name}")
    return parser


def _add_bundle(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path, help="the bundle")


def _add_build(commands: Any) -> None:
    parser = _command(commands, "build", "make a bundle from a folder")
    parser.add_argument(
        "folder", metavar="FOLDER", type=Path, help="the folder that holds the modules and packages, and nothing else"
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="the bundle to write")
    parser.add_argument("--name", required=True, metavar="NAME", help="the name of the bundle")
    parser.add_argument(
        "--version", required=True, type=int, metavar="N", help="its version, higher than that of every earlier one"
    )
    parser.add_argument(
        "--image",
        action="append",
        required=True,
        metavar="MODULE:CLASS",
        help="an image that it holds, as a spec writes it; repeat the option for each",
    )
    parser.add_argument(
        "--wheel",
        action="append",
        default=[],
        metavar="REQUIREMENT",
        help="a package that the PE must have, as pip writes it; repeat the option for each",
    )
