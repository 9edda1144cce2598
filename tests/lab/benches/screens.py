"""How soon an event is on the screen, and what the screens cost: a real manager, `heronry web`, and Debian's Chromium.

    python -m lab.benches.screens [--events 2000] [--starts 5] [--minutes 0] [--fault-every 10] [--spec big_blue]
                                  [--heartbeat-ms MS]

    event to screen   from the manager's time of an event until the frame in which the browser has drawn its line. The
                      operator fails and clears a device meanwhile, from five seconds after the page was opened. The
                      page's clock is compared with the manager's (CLOCK_MONOTONIC, as in Chromium) twenty times; the
                      closest pair of readings counts. `heronry web` has a session of its own, as in a terminal of its
                      own: Linux shares the processors among sessions
                      Late events come in clusters, several from one wait for a processor: 500 events are too few for a
                      p99 that the next run repeats
    demo to graph     from the start of `heronry demo --web` until the graph is in the browser, which runs already; and
                      until the address is printed, and the first configuration runs. The first start is not counted
    --minutes M       two pages and `heronry top` (in a pseudo-terminal of 200x50) at full traffic, with a fault or its
                      end every ten seconds (--fault-every): the share of a core that `heronry web` and top take, the
                      memory of both after a third of the time and at its end, and the heap of a page after a sixth and
                      at the end, each after a forced collection

Nodes, pages and browser share this computer. With --heartbeat-ms all buses have slower heartbeats, so that a small
computer has time to spare; how busy it was is told with the times.

Exit code 1 where the p99 of event to screen is above 250 ms; with --minutes 30 or more also where a memory has grown by
more than 2 MiB, or the heap by more than a tenth. A busy computer does not meet these.
"""

import json
import os
import pty
import shutil
import subprocess
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from queue import SimpleQueue
from random import Random
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any, Final

from playwright.sync_api import Browser, Page, sync_playwright

from heronry_manager.core.vocabulary import ClearElement, FailElement
from heronry_manager.events import Event, Reconfigured
from heronry_manager.events import Page as PageEvent
from heronry_manager.events.reading import events_in
from heronry_tools.console.errors import UserError
from heronry_tools.console.number_arguments import whole_number
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.fleet import Fleet
from heronry_wire import interruption
from lab.benches.fleets import Aircraft, aircraft
from lab.benches.harness import Benchmark, Report, counted, option, spec_option
from lab.benches.processes import busy_s, busy_share, cpu_s, resident_mib
from lab.slow_spec import slow_spec

_HERONRY: Final = [sys.executable, "-m", "heronry_tools"]
_FLAGS: Final = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
_MOST_MS: Final = 250.0
_PATIENCE_MS: Final = 300_000  # of a busy computer, which opens a page late
_SETTLING_MS: Final = 5_000  # the start of a browser takes both processors of a small computer
_STANDSTILL_S, _AGAIN_S = 10.0, 0.5
_WHOLE_MIN: Final = 30  # minutes, from which on the limits of memory hold
_MOST_GROWTH_MIB: Final = 2.0
_MOST_HEAP_GROWTH: Final = 0.1
_BETWEEN_ORDERS_S: Final = (0.3, 0.9)  # drawn from here, so that events meet every moment of the stream's period
_NOTE_ROWS: Final = """() => {
    globalThis.drawn = [];
    new MutationObserver((changes) => {
        const rows = changes.flatMap((change) => [...change.addedNodes]).map((row) => Number(row.dataset?.number));
        requestAnimationFrame(() => drawn.push(...rows.map((row) => [row, performance.now()])));
    }).observe(document.getElementById("events"), { childList: true });
}"""
_TAKE_ROWS: Final = """() => {
    const at = Object.fromEntries(heronry.store.snapshot.told.map((one) => [one.number, one.t_ns]));
    return drawn.splice(0).map(([row, ms]) => [row, at[row] ?? null, ms]);
}"""


def _new_page(browser: Browser) -> Page:
    page = browser.new_page()
    page.set_default_timeout(_PATIENCE_MS)
    return page


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Debian's Chromium; raises UserError if there is none."""
    with chromiums(1) as (opened,):
        yield opened


@contextmanager
def chromiums(count: int) -> Iterator[list[Browser]]:
    """Start Debian's Chromium so many times, each with processes of its own; raises UserError if there is none."""
    found = shutil.which("chromium")
    if found is None:
        raise UserError("there is no Chromium here: as root, apt-get install chromium")
    with sync_playwright() as playwright:
        opened = [playwright.chromium.launch(executable_path=found, args=_FLAGS) for _ in range(count)]
        try:
            yield opened
        finally:
            for one in opened:
                one.close()


@dataclass(slots=True)
class DisturbedFlight:
    """An aircraft whose configuration runs, with a device that fails and is repaired in turn."""

    fleet: Fleet
    device: str
    faults: Iterator[type[FailElement] | type[ClearElement]] = field(
        default_factory=lambda: cycle((FailElement, ClearElement))
    )

    def disturb(self) -> None:
        """Fail the device, or clear it; a manager that listens again, after a standstill, is asked until it accepts."""
        order, until_s = next(self.faults)(self.device), time.monotonic() + _STANDSTILL_S
        while True:
            try:
                return self.fleet.order(order, "the benchmark")
            except UserError:
                if time.monotonic() > until_s:
                    raise
            time.sleep(_AGAIN_S)


@contextmanager
def disturbed_flight(spec_name: str) -> Iterator[DisturbedFlight]:
    """Fly a spec until its first configuration runs, and end all processes at the end."""
    with aircraft(spec_name) as flown:
        events = AwaitedEvents(flown.fleet, flown.fleet.start_manager())
        flown.start_pes()
        events.wait(Reconfigured)
        over = threading.Event()
        reader = Thread(target=_read_all, args=(events, over))
        reader.start()
        try:
            yield DisturbedFlight(flown.fleet, _device(flown))
        finally:
            over.set()
            reader.join()


def _read_all(events: AwaitedEvents, over: threading.Event) -> None:
    """Read the manager's events until the end: a manager whose pipe is full stands still."""
    with suppress(SystemExit):
        while not over.wait(0.02):
            events.take()


def _device(flown: Aircraft) -> str:
    return f"device:{next(iter(flown.spec.devices))}"


@contextmanager
def served_page(flight: DisturbedFlight, python: str = sys.executable) -> Iterator[tuple[str, int]]:
    """Run `heronry web` on the manager of a flight; yields its address and its process number.

    python: the interpreter; that of another checkout serves the page of that checkout.
    """
    typed = [python, *_HERONRY[1:], "web", "--socket", str(flight.fleet.control_socket()), "--json", "--until-eof"]
    process = subprocess.Popen(typed, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        if not line:
            raise SystemExit("the benchmark ends here: 'heronry web' has ended, for the reason above")
        yield json.loads(line)["address"], process.pid
    finally:
        process.terminate()
        process.wait()


def _event_to_screen(spec_name: str, browser: Browser, count: int) -> list[float]:
    """Return the time from each event until it is drawn, in ms."""
    with disturbed_flight(spec_name) as flight, served_page(flight) as (address, _):
        page = _new_page(browser)
        page.goto(f"{address}#/events")
        page.wait_for_selector("#events tr")
        page.wait_for_timeout(_SETTLING_MS)
        page.evaluate(_NOTE_ROWS)
        offset_ns, random = _offset_ns(page), Random("moments of orders")
        found: dict[int, float] = {}
        until_s = time.monotonic() + 2 * count
        while len(found) < count and time.monotonic() < until_s:
            flight.disturb()
            page.wait_for_timeout(1000 * random.uniform(*_BETWEEN_ORDERS_S))
            for row, t_ns, ms in page.evaluate(_TAKE_ROWS):
                if t_ns is not None:
                    found.setdefault(row, ms - (t_ns - offset_ns) / 1e6)
        page.close()
        return list(found.values())[:count]


def _offset_ns(page: Page) -> int:
    """Return CLOCK_MONOTONIC at the moment 0 of the page's clock."""
    best = (sys.maxsize, 0)
    for _ in range(20):
        before_ns = time.monotonic_ns()
        ms = page.evaluate("performance.now()")
        after_ns = time.monotonic_ns()
        best = min(best, (after_ns - before_ns, (before_ns + after_ns) // 2 - round(1e6 * ms)))
    return best[1]


def _start(spec_name: str, browser: Browser) -> dict[str, float]:
    """Start a demo; gives the times in ms until the address is printed, a configuration runs, the graph is drawn."""
    begun_s = time.monotonic()
    process = subprocess.Popen([*_HERONRY, "demo", spec_name, "--web", "--json"], stdout=subprocess.PIPE, text=True)
    told: dict[type[Event], _Told] = {PageEvent: _Told(), Reconfigured: _Told()}
    reader = Thread(target=_read_demo, args=(process, begun_s, told))
    reader.start()
    page = _new_page(browser)
    try:
        address_ms, found = told[PageEvent].get()
        assert isinstance(found, PageEvent)
        page.goto(found.address)
        page.wait_for_selector("#graph .node")
        graph_ms = _passed_ms(begun_s)
        configured_ms, _ = told[Reconfigured].get()
    finally:
        page.close()
        process.terminate()
        process.wait()
        reader.join()
    return {"demo to address": address_ms, "demo to configuration": configured_ms, "demo to graph": graph_ms}


class _Told:
    """The first line of a demo about one kind of event, for which another thread waits."""

    def __init__(self) -> None:
        self._lines: SimpleQueue[tuple[float, Event] | None] = SimpleQueue()

    def put(self, line: tuple[float, Event] | None) -> None:
        """Note a line, with the time in ms when it came; None: the demo has ended."""
        self._lines.put(line)

    def get(self) -> tuple[float, Event]:
        """Wait for the line."""
        line = self._lines.get()
        if line is None:
            raise SystemExit("the benchmark ends here: 'heronry demo' has ended, for the reason above")
        return line


def _read_demo(process: "subprocess.Popen[str]", begun_s: float, told: dict[type[Event], _Told]) -> None:
    """Read all lines of a demo: one whose pipe is full stands still."""
    assert process.stdout is not None
    for event in events_in(process.stdout):
        if type(event) in told:
            told[type(event)].put((_passed_ms(begun_s), event))
    for one in told.values():
        one.put(None)


def _passed_ms(begun_s: float) -> float:
    return 1000 * (time.monotonic() - begun_s)


class _Top:
    """`heronry top` in a pseudo-terminal, whose output is read and thrown away."""

    def __init__(self, fleet: Fleet) -> None:
        self._ours, theirs = pty.openpty()
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "200", "LINES": "50"}
        typed = [*_HERONRY, "top", "--socket", str(fleet.control_socket())]
        self._process = subprocess.Popen(typed, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
        os.close(theirs)
        self.pid = self._process.pid
        self._reader = Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        with suppress(OSError):  # it has ended
            while os.read(self._ours, 1 << 16):
                pass

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()
        self._reader.join()
        os.close(self._ours)


@dataclass(slots=True)
class _Cost:
    """What screens cost: shares of a core, memory in MiB, the heap of a page in bytes."""

    web_share: float = 0.0
    top_share: float = 0.0
    web_mib: list[float] = field(default_factory=list)
    top_mib: list[float] = field(default_factory=list)
    heap_bytes: list[int] = field(default_factory=list)


def _cost(browser: Browser, arguments: Namespace) -> _Cost:
    with disturbed_flight(arguments.spec) as flight, served_page(flight) as (address, web):
        pages = [_new_page(browser) for _ in range(2)]
        for page in pages:
            page.goto(address)
            page.wait_for_selector("#graph .node")
        top = _Top(flight.fleet)
        try:
            return _watched(flight, pages, web, top, arguments)
        finally:
            top.close()


def _watched(flight: DisturbedFlight, pages: list[Page], web: int, top: _Top, arguments: Namespace) -> _Cost:
    cost, begun_s, next_s, long_s = _Cost(), time.monotonic(), 0.0, 60 * arguments.minutes
    before = cpu_s(web), cpu_s(top.pid)
    marks = [(long_s / 6, "heap"), (long_s / 3, "memory"), (long_s, "heap"), (long_s, "memory")]
    while marks:
        passed_s = time.monotonic() - begun_s
        if passed_s >= next_s:
            flight.disturb()
            next_s += arguments.fault_every
        pages[0].wait_for_timeout(200)
        while marks and passed_s >= marks[0][0]:
            if marks.pop(0)[1] == "heap":
                cost.heap_bytes.append(heap_bytes(pages[0]))
            else:
                cost.web_mib.append(resident_mib(web))
                cost.top_mib.append(resident_mib(top.pid))
    passed_s = time.monotonic() - begun_s
    cost.web_share, cost.top_share = (
        (cpu_s(pid) - used_s) / passed_s for pid, used_s in zip((web, top.pid), before, strict=True)
    )
    return cost


def heap_bytes(page: Page) -> int:
    """Return the heap of a page after a forced collection."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.enable")
    session.send("HeapProfiler.collectGarbage")
    used: dict[str, Any] = session.send("Runtime.getHeapUsage")
    session.send("HeapProfiler.disable")
    session.detach()
    return int(used["usedSize"])


def measure(arguments: Namespace, report: Report) -> None:
    """Measure the times, and with --minutes the cost."""
    slower_ms = arguments.heartbeat_ms
    heartbeats = "" if slower_ms is None else f", heartbeats of {slower_ms} ms"
    report.begin(f"{arguments.spec}{heartbeats}, software bus, Chromium")
    with interruption.in_order(), TemporaryDirectory() as folder, chromium() as browser:
        if slower_ms is not None:
            arguments.spec = str(slow_spec(arguments.spec, Path(folder), heartbeat_ms=slower_ms))
        if arguments.events:
            before_s = busy_s()
            report.times("event to screen", _event_to_screen(arguments.spec, browser, arguments.events), limit=_MOST_MS)
            report.figures("  this computer was busy for {busy:.0%} of that time", busy=busy_share(before_s))
        if arguments.starts:
            _start(arguments.spec, browser)
            counts = counted("starts", arguments.starts, range(arguments.starts))
            starts = [_start(arguments.spec, browser) for _ in counts]
            for what in starts[0]:
                report.times(what, [one[what] for one in starts])
        if arguments.minutes:
            _tell(_cost(browser, arguments), arguments.minutes, report)


def _tell(cost: _Cost, minutes: float, report: Report) -> None:
    web, top = (values[-1] - values[0] for values in (cost.web_mib, cost.top_mib))
    heap = cost.heap_bytes[-1] / cost.heap_bytes[0] - 1
    report.figures(
        "  {minutes:g} minutes: web with two pages takes {web_share:.1%} of a core, top {top_share:.1%}\n"
        "  web: {web_mib:.1f} MiB after a third, {web_growth_mib:+.1f} MiB until the end\n"
        "  top: {top_mib:.1f} MiB after a third, {top_growth_mib:+.1f} MiB until the end\n"
        "  page: heap of {heap_mib:.1f} MiB after a sixth, {heap:+.1%} at the end",
        minutes=minutes,
        web_share=cost.web_share,
        top_share=cost.top_share,
        web_mib=cost.web_mib[0],
        web_growth_mib=web,
        top_mib=cost.top_mib[0],
        top_growth_mib=top,
        heap_mib=cost.heap_bytes[0] / 2**20,
        heap=heap,
    )
    if minutes >= _WHOLE_MIN:
        report.require(max(web, top) <= _MOST_GROWTH_MIB and heap <= _MOST_HEAP_GROWTH)


main = Benchmark(
    "screens",
    __doc__,
    measure,
    option("--events", 2000, "events that are awaited on the screen", whole_number),
    option("--starts", 5, "starts of a demo", whole_number),
    option("--minutes", 0.0, "for which the screens are watched", float, "M"),
    option("--fault-every", 10.0, "seconds between a fault and its end", float, "S"),
    spec_option("big_blue"),
    option("--heartbeat-ms", None, "heartbeat period of every bus (default: that of the spec)", metavar="MS"),
)
if __name__ == "__main__":
    sys.exit(main())
