"""The command line of `heronry eds`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import add_output_file

_EPILOG = """\
examples:
  heronry eds -o heronry_pe.eds                  network.add_node(92, "heronry_pe.eds") in the canopen package
  heronry eds | grep ParameterName               every object by name

All PEs have the same objects, whatever their spec, so there is one file; a PE also gives it by SDO (object 1021h).
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry eds`."""
    parser = subparsers.add_parser(
        "eds",
        description="Write the object dictionary of a PE as an electronic data sheet (CiA 306).",
        epilog=_EPILOG,
    )
    add_output_file(parser, "EDS", ".eds")
