"""The option --compiled of the commands that fly often."""

import argparse


def add_compiled_argument(parser: argparse.ArgumentParser) -> None:
    """Add --compiled to the parser of a command that flies often."""
    parser.add_argument(
        "--compiled", action="store_true", help="fly machine code of the same source: four times as fast, made once"
    )


def go_on_compiled_if_asked(arguments: argparse.Namespace) -> None:
    """Go on in another process where --compiled is given."""
    if arguments.compiled:
        from heronry_tools.sim.compiled.machine_code import go_on_compiled  # noqa: PLC0415 - slow to import

        go_on_compiled(arguments.argv)
