"""The time from a script of the operator until it runs everywhere, measured with real processes on a software bus.

    python -m lab.benches.live_scripts [--scripts 50] [--spec big_blue]

A script moves one module to another PE, the next one moves it back, and so on. The scripts are given over the
operator's socket, as `heronry pcs apply --live` gives them. The time counts from just before the manager gets the
script until every PE has activated the configuration; it contains the script's check, the search for the best plan
with which the manager compares the script, PREPARE and ACTIVATE. The manager measures the last two.
"""

import json
import sys
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.plan import Plan, read_plan
from heronry_dg.situation import Situation, hosts_when_all_is_up
from heronry_dg.verify import verify
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_protocol import FlyScript
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from lab.benches.fleets import aircraft
from lab.benches.harness import Benchmark, Report, counted, option, spec_option

_IN_ALL, _DEPLOYED = "script to active", "prepare to active"
_CALM_S = 5.0  # after the first configuration
_SETTLE_S = 1.0  # between two scripts


def measure(arguments: Namespace, report: Report) -> None:
    """Fly the scripts, and report the times."""
    report.begin(f"{arguments.spec}, {arguments.scripts} scripts, software bus")
    for name, values in times_of(arguments.spec, arguments.scripts).items():
        report.times(name, values)


def times_of(spec_name: str, scripts: int) -> dict[str, list[float]]:
    """Give the times in milliseconds, by name, one per script; raises UserError where the manager refuses one."""
    times: dict[str, list[float]] = {_IN_ALL: [], _DEPLOYED: []}
    with aircraft(spec_name) as flown:
        events = AwaitedEvents(flown.fleet, flown.fleet.start_manager())
        flown.start_pes()
        told = [events.wait("plan_ready"), events.wait("reconfigured")]
        time.sleep(_CALM_S)  # every PE has joined, and a better plan has been deployed
        there_and_back = scripts_of(flown.spec, _running([*told, *events.take()], flown.spec))
        for number in counted("scripts", scripts, range(scripts)):
            time.sleep(_SETTLE_S)
            events.take()
            given_ns = time.monotonic_ns()
            answer = call(flown.fleet.control_socket(), FlyScript(there_and_back[number % 2]))
            if not answer.done:
                raise UserError(f"the manager has refused script {number}: {answer.sentence}")
            done = events.wait("reconfigured")
            times[_IN_ALL].append((done["t_ns"] - given_ns) / 1e6)
            times[_DEPLOYED].append((done["times_ns"]["distribute"] + done["times_ns"]["activate"]) / 1e6)
    return times


def _running(told: Sequence[Mapping[str, Any]], spec: Spec) -> Plan:
    """Give the plan that runs: the last one that was ready before the last reconfiguration ended."""
    ended = max(place for place, event in enumerate(told) if event["event"] == "reconfigured")
    ready = [event["plan"] for event in told[:ended] if event["event"] == "plan_ready"]
    return read_plan(json.dumps(ready[-1]), spec)


def scripts_of(spec: Spec, planned: Plan) -> tuple[str, str]:
    """Give a script that moves the first module that can move, and the script that moves it back."""
    _, there = moved(spec, planned.now, planned.configuration)
    graphs = module_graph(spec, planned.configuration), module_graph(spec, there)
    return difference(*graphs), difference(*graphs[::-1])


def moved(spec: Spec, now: Situation, running: Configuration) -> tuple[str, Configuration]:
    """Give the first module that may run on another PE while all else stays, and the configuration with it there."""
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
)
if __name__ == "__main__":
    sys.exit(main())
