"""`heronry metrics`: writes the metrics of a system for Prometheus once, or serves them over HTTP."""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from heronry_tools.console.number_arguments import whole_number
from heronry_tools.console.output import add_output_file
from heronry_tools.sources.arguments import EXAMPLES, add_source_arguments

if TYPE_CHECKING:
    from heronry_tools.watch.top.sources import TopSource

_EPILOG = f"""\
examples:
{EXAMPLES.format(command="metrics")}\
  heronry metrics --port 9464                         serve them on http://127.0.0.1:9464/metrics

Names and units follow the conventions of Prometheus. Needs: pip install "heronry[export]"
"""
_LISTENS_S = 1.5  # time to listen before metrics are printed once: the traffic is measured over a second


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry metrics`."""
    parser = subparsers.add_parser(
        "metrics", description="Write the metrics of a system for Prometheus once, or serve them.", epilog=_EPILOG
    )
    add_source_arguments(parser)
    add_output_file(parser, "the text format of Prometheus", ".prom")
    parser.add_argument("--port", type=whole_number, metavar="N", help="serve /metrics on this port of 127.0.0.1")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the metrics once, or serve them until a signal (with --port); returns 0."""
    from heronry_tools.sources.opened import opened_source  # noqa: PLC0415
    from heronry_tools.watch.metrics import exposition  # noqa: PLC0415 - with all below slow to import
    from heronry_tools.watch.metrics_server import serve  # noqa: PLC0415
    from heronry_tools.watch.top.sources import source_of  # noqa: PLC0415

    source = source_of(opened_source(arguments))
    try:
        if arguments.port is not None:
            serve(source, arguments.port)
            return 0
        _listen(source)
        sys.stdout.write(exposition(source.snapshot()).decode())
    finally:
        source.close()
    return 0


def _listen(source: "TopSource") -> None:
    import select  # noqa: PLC0415
    import time  # noqa: PLC0415

    until_s = time.monotonic() + _LISTENS_S
    source.look()
    while not source.is_recorded and time.monotonic() < until_s:
        select.select(source.readers(), [], [], 0.1)
        source.look()
