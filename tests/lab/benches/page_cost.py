"""What a page costs this computer, server and browser, side by side: as it is, with a plot open, and of another commit.

    python -m lab.benches.page_cost [--minutes 5] [--plot altitude] [--beside PYTHON] [--spec big_blue]
                                    [--heartbeat-ms MS] [--fault-every 10]

All sides watch the same manager at the same time, each with a `heronry web` and a Chromium of its own. So all get the
same events, and wait for the same processors:

    this            the page on its graph
    plot            the page on a plot of the variable that --plot names
    beside          the page of another checkout on its graph; --beside names the Python in the environment there:

        git worktree add /tmp/before COMMIT && make -C /tmp/before .venv/ready-to-test
        python -m lab.benches.page_cost --beside /tmp/before/.venv/bin/python

The first tenth of the time does not count: pages open. Then the processor time of the server, and of the browser with
all its processes, is told as a share of a core.
"""

import sys
import time
from argparse import Namespace
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from playwright.sync_api import Browser, CDPSession

from heronry_wire import interruption
from lab.benches.harness import Benchmark, Report, option, spec_option
from lab.benches.processes import busy_s, busy_share, cpu_s
from lab.benches.screens import DisturbedFlight, chromiums, disturbed_flight, served_page
from lab.slow_spec import slow_spec

_UNCOUNTED: Final = 0.1  # of the time
_PATIENCE_MS: Final = 300_000


@dataclass(frozen=True, slots=True)
class Side:
    """One page with its server.

    python: the interpreter that serves the page.
    panel: the part of the address that chooses what the page shows, and the element that is there when it is drawn.
    """

    name: str
    python: str
    panel: tuple[str, str] = ("#/graph", "#graph .box, #graph .node")


@dataclass(frozen=True, slots=True)
class Watched:
    """A side that runs: its server's process, and a connection that tells the processor time of its browser."""

    side: Side
    web: int
    browser: CDPSession

    def cpu_s(self) -> tuple[float, float]:
        """Return the processor time (s) of server and browser so far."""
        told = self.browser.send("SystemInfo.getProcessInfo")["processInfo"]
        return cpu_s(self.web), sum(one["cpuTime"] for one in told)


def _sides(arguments: Namespace) -> list[Side]:
    plot = f"#/plots/{arguments.plot}", f'[data-plot="{arguments.plot}"] canvas'
    found = [Side("this", sys.executable), Side("plot", sys.executable, plot)]
    return found if arguments.beside is None else [*found, Side("beside", arguments.beside)]


def _open(browser: Browser, address: str, side: Side) -> None:
    page = browser.new_page()
    page.set_default_timeout(_PATIENCE_MS)
    page.goto(f"{address}{side.panel[0]}")
    page.wait_for_selector(side.panel[1])


def measure(arguments: Namespace, report: Report) -> None:
    """Measure all sides at once."""
    slower_ms = arguments.heartbeat_ms
    with interruption.in_order(), TemporaryDirectory() as folder, ExitStack() as open_things:
        spec = (
            arguments.spec
            if slower_ms is None
            else str(slow_spec(arguments.spec, Path(folder), heartbeat_ms=slower_ms))
        )
        report.begin(f"{arguments.spec}, software bus, Chromium, {arguments.minutes:g} minutes")
        flight = open_things.enter_context(disturbed_flight(spec))
        sides = _sides(arguments)
        browsers = open_things.enter_context(chromiums(len(sides)))
        watched = []
        for side, browser in zip(sides, browsers, strict=True):
            address, web = open_things.enter_context(served_page(flight, side.python))
            _open(browser, address, side)
            watched.append(Watched(side, web, browser.new_browser_cdp_session()))
        long_s = 60 * arguments.minutes
        _disturb(flight, _UNCOUNTED * long_s, arguments.fault_every)
        begun_s, before, busy = time.monotonic(), [one.cpu_s() for one in watched], busy_s()
        _disturb(flight, (1 - _UNCOUNTED) * long_s, arguments.fault_every)
        passed_s = time.monotonic() - begun_s
        for one, was in zip(watched, before, strict=True):
            server, pages = ((now - then) / passed_s for now, then in zip(one.cpu_s(), was, strict=True))
            name = one.side.name
            report.figures(
                f"  {name}: server {{{name}_server:.1%}}, browser {{{name}_browser:.1%}} of a core",
                **{f"{name}_server": server, f"{name}_browser": pages},
            )
        report.figures("  this computer was busy for {busy:.0%} of that time", busy=busy_share(busy))


def _disturb(flight: DisturbedFlight, for_s: float, every_s: float) -> None:
    """Let a device fail, or clear it, every so many seconds."""
    until_s = time.monotonic() + for_s
    while (left_s := until_s - time.monotonic()) > 0:
        flight.disturb()
        time.sleep(min(every_s, left_s))


main = Benchmark(
    "page_cost",
    __doc__,
    measure,
    option("--minutes", 5.0, "for which the pages are watched", float, "M"),
    option("--plot", "altitude", "the variable of the plot", str, "VARIABLE"),
    option("--beside", None, "Python of another checkout, whose page is watched too", str, "PYTHON"),
    option("--fault-every", 10.0, "seconds between a fault and its end", float, "S"),
    spec_option("big_blue"),
    option("--heartbeat-ms", None, "heartbeat period of every bus (default: that of the spec)", metavar="MS"),
)
if __name__ == "__main__":
    sys.exit(main())
