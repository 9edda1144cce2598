"""The option --compiled of the commands that simulate many flights."""

import argparse


def add_compiled_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option --compiled to a parser."""
    parser.add_argument(
        "--compiled",
        action="store_true",
        help="run the simulator as machine code, four times as fast; the first run with this option compiles it",
    )


def go_on_compiled_if_asked(arguments: argparse.Namespace) -> None:
    """Run the command in a compiled process if --compiled is given; in that case this function does not return."""
    if arguments.compiled:
        from heronry_tools.sim.compiled.machine_code import go_on_compiled  # noqa: PLC0415 - slow to import

        go_on_compiled(arguments.argv)
