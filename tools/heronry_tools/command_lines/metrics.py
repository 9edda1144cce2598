"""The command line of `heronry metrics`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.number_arguments import whole_number
from heronry_tools.console.output import add_output_file
from heronry_tools.console.source_arguments import EXAMPLES, add_source_arguments

_EPILOG = f"""\
examples:
{EXAMPLES.format(command="metrics")}\
  heronry metrics --port 9464                         serve them on http://127.0.0.1:9464/metrics

Names and units follow the conventions of Prometheus. Needs: pip install "heronry[export]"
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry metrics`."""
    parser = subparsers.add_parser(
        "metrics", description="Write the metrics of a system for Prometheus once, or serve them.", epilog=_EPILOG
    )
    add_source_arguments(parser)
    add_output_file(parser, "the text format of Prometheus", ".prom")
    parser.add_argument("--port", type=whole_number, metavar="N", help="serve /metrics on this port of 127.0.0.1")
