"""`heronry metrics`: writes the metrics of a system for Prometheus once, or serves them over HTTP."""

import argparse
import select
import sys
import time

from heronry_tools.sources.opened import opened_source
from heronry_tools.watch.metrics import exposition
from heronry_tools.watch.metrics_server import serve
from heronry_tools.watch.top.sources import TopSource, source_of

_LISTENS_S = 1.5  # time to listen before metrics are printed once: the traffic is measured over a second


def run(arguments: argparse.Namespace) -> int:
    """Print the metrics once, or serve them until a signal (with --port); returns 0."""
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


def _listen(source: TopSource) -> None:
    until_s = time.monotonic() + _LISTENS_S
    source.look()
    while not source.is_recorded and time.monotonic() < until_s:
        select.select(source.readers(), [], [], 0.1)
        source.look()
