"""The time from a script of the operator until it runs everywhere, measured with real processes on a software bus.

    python -m lab.benches.live_scripts [--scripts 50] [--spec big_blue] [--heartbeat-ms MS]

Each script moves one module to another PE. The scripts are given over the operator's socket, as `heronry pcs apply
--live` gives them, each when all PEs are up and nothing is under way. The time counts from just before the manager gets
the script until every PE has activated the configuration. The manager tells how it divides:

    decide        the script's check, and the search for the best plan with which the manager compares the script
    distribute    from PREPARE until every PE has staged its slice
    activate      from the first ACTIVATE until every PE is active

If a PE is lost or joins meanwhile, the script does not count, and another one is given in its place. On a computer that
is too slow for the spec's heartbeats, that happens to most scripts: `--heartbeat-ms` gives all buses slower ones, and
then every step of the two phases takes longer, too.
"""

import json
import sys
import time
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.plan import Plan, read_plan
from heronry_dg.plan_document import plain
from heronry_dg.situation import Situation, hosts_when_all_is_up
from heronry_dg.verify import verify
from heronry_manager.core.epochs import Stage
from heronry_manager.core.membership import Standing
from heronry_manager.events import PeJoined, PeLost, Reconfigured, ScriptRefused, Status
from heronry_manager.events.reading import read_event
from heronry_manager.shell.control_client import call, follow
from heronry_manager.shell.control_protocol import FlyScript
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from lab.benches.fleets import Aircraft, aircraft
from lab.benches.harness import Benchmark, Report, counted, option, spec_option
from lab.slow_spec import slow_spec

_IN_ALL, _PARTS = "script to active", ("decide", "distribute", "activate")
_LOOK_S = 0.1
_CALM_S = 3.0  # at the start, when the PEs come one after the other
_SETTLE_S = 0.5  # between two scripts
_LONGEST_CALM_S = 60.0
_CAUSE = "a script of the operator"


def measure(arguments: Namespace, report: Report) -> None:
    """Fly the scripts, and report the times."""
    with TemporaryDirectory() as folder:
        spec, slower_ms = arguments.spec, arguments.heartbeat_ms
        if slower_ms is not None:
            spec = str(slow_spec(spec, Path(folder), heartbeat_ms=slower_ms))
        heartbeats = "" if slower_ms is None else f", heartbeats of {slower_ms} ms"
        report.begin(f"{arguments.spec}, {arguments.scripts} scripts, software bus{heartbeats}")
        times, disturbed = times_of(spec, arguments.scripts)
    report.figures("{disturbed} more scripts do not count: a PE was lost or joined meanwhile", disturbed=disturbed)
    for name, values in times.items():
        report.times(name, values)


def times_of(spec_name: str, scripts: int) -> tuple[dict[str, list[float]], int]:
    """Return the times in milliseconds, by name, one per script; and how many more scripts were disturbed.

    Raises UserError if most scripts are disturbed.
    """
    times: dict[str, list[float]] = {name: [] for name in (_IN_ALL, *_PARTS)}
    disturbed = 0
    with aircraft(spec_name) as flown:
        events = AwaitedEvents(flown.fleet, flown.fleet.start_manager())
        flown.start_pes()
        events.wait(Reconfigured)
        calm_plan(flown, _CALM_S)
        for _ in counted("scripts", scripts, range(scripts)):
            while (found := _fly_one(flown, events)) is None:
                disturbed += 1
                if disturbed > scripts:
                    raise UserError(f"{disturbed} scripts were disturbed: give the buses slower --heartbeat-ms")
            for name, value in found.items():
                times[name].append(value)
    return times, disturbed


def _fly_one(flown: Aircraft, events: AwaitedEvents) -> dict[str, float] | None:
    """Fly a script; gives its times in milliseconds, by name, or None if anything else happened meanwhile."""
    name, script = script_of(flown.spec, calm_plan(flown, _SETTLE_S))
    events.take()
    given_ns = time.monotonic_ns()
    if not call(flown.fleet.control_socket(), FlyScript(script)).done:
        return None
    done = events.wait(Reconfigured, ScriptRefused, PeLost, PeJoined)
    if not isinstance(done, Reconfigured) or (done.causes, done.moved) != ((_CAUSE,), (name,)):
        return None
    parts = {part: ns / 1e6 for part, ns in done.times_ns.by_name().items() if part in _PARTS and ns is not None}
    return {_IN_ALL: (done.t_ns - given_ns) / 1e6, **parts}


def calm_plan(flown: Aircraft, calm_s: float) -> Plan:
    """Wait until all PEs have been up for so long, and nothing has been under way; gives the plan that runs.

    Raises UserError if it does not become calm.
    """
    began_s = since_s = time.monotonic()
    while True:
        with follow(flown.fleet.control_socket()) as line, line.makefile("rb") as lines:
            told = read_event(lines.readline())
        assert isinstance(told, Status)
        now_s = time.monotonic()
        since_s = since_s if _is_calm(told.status) else now_s
        if now_s - since_s >= calm_s:
            return read_plan(json.dumps(plain(told.plan)), flown.spec)
        if now_s - began_s > _LONGEST_CALM_S:
            states = {pe: one["state"] for pe, one in told.status["pes"].items()}
            raise UserError(f"something was under way, or not all PEs were up, for {_LONGEST_CALM_S:.0f} s: {states}")
        time.sleep(_LOOK_S)


def _is_calm(status: Mapping[str, Any]) -> bool:
    is_settled = status["stage"] == Stage.DONE.value and status["next"] is None and not status["manager"]["planning"]
    return is_settled and all(pe["state"] == Standing.UP.value for pe in status["pes"].values())


def script_of(spec: Spec, running: Plan) -> tuple[str, str]:
    """Return the first module that can move to another PE, and the script that moves it."""
    name, there = moved(spec, running.now, running.configuration)
    return name, difference(module_graph(spec, running.configuration), module_graph(spec, there))


def moved(spec: Spec, now: Situation, running: Configuration) -> tuple[str, Configuration]:
    """Return the first module that may run on another PE while all else stays, and the configuration with it there."""
    for name, one in running.modules.items():
        for pe in hosts_when_all_is_up(spec, spec.modules[name]):
            there = Configuration({**running.modules, name: replace(one, pe=pe)})
            if pe != one.pe and not verify(spec, now, there):
                return name, there
    raise UserError(f"no module of {spec.name} can run on another PE while all else stays")


main = Benchmark(
    "live_scripts",
    __doc__,
    measure,
    option("--scripts", 50, "how many scripts"),
    spec_option("big_blue"),
    option("--heartbeat-ms", None, "heartbeat period of every bus (default: that of the spec)", metavar="MS"),
)
if __name__ == "__main__":
    sys.exit(main())
