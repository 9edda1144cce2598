"""One inspection of a system before take-off: asks its manager, listens to its buses, and asks its PEs by SDO.

The order matters. The manager's first status tells what runs, and so what must be heard. Its second status, after the
listening, tells what it thinks of what was heard meanwhile. SDO comes last, since it loads the buses.

Each trouble is named once, at its cause: of a PE that is not heard nothing else is told, and functions come last.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager.events import Status
from heronry_tools.preflight.inputs import WiredInputs
from heronry_tools.preflight.survey import Survey
from heronry_tools.preflight.told import (
    assess_contingencies,
    assess_key,
    assess_spec,
    files_of,
    journal_folder,
    silent_data,
)
from heronry_tools.reports.findings import Finding
from heronry_tools.reports.troubles import (
    code_troubles,
    element_troubles,
    function_troubles,
    manager_troubles,
    silence_troubles,
    standing_troubles,
)
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_tools.runtime.doctor.computer import assess_computer, assess_date, assess_disk, assess_wake_ups
from heronry_tools.runtime.wake_ups import latest_wake_up_ns, with_heartbeat
from heronry_tools.watch.configurations import RunningPlan
from heronry_tools.watch.live_feeds import status_now
from heronry_wire.authentication import Key

_REHEARSAL_S = 1.0
_MARGIN_S = 0.5  # of listening, beyond the longest silence that is judged


@dataclass(frozen=True, slots=True)
class Inspection:
    """What is to be inspected, and how.

    spec: what is to fly; `named`: as the user named it. socket: of the manager.
    buses: those that the user names; the manager's own bus is taken from its status if it is not among them.
    seconds: how long to listen, unless something that is judged is slower.
    key: what the manager must have; None: any, or none.
    """

    spec: Spec
    named: str
    socket: Path
    buses: Sequence[BusChoice]
    seconds: float
    key: Key | None = None

    def findings(self) -> list[Finding]:
        """Inspect everything once; raises ControlError if no manager answers."""
        before = status_now(self.socket)
        spec, is_spec = _as_flown(self.spec, before.status), assess_spec(before.status, self.spec, self.named)
        found = [*_computer(spec, before), is_spec]
        if is_spec.is_right:  # else the PEs, buses and data are those of another spec
            found += self._system(spec, before)
        return [replace(one, remedy=one.remedy and one.remedy.replace(" SPEC", f" {self.named}")) for one in found]

    def _system(self, spec: Spec, before: Status) -> list[Finding]:
        """Inspect manager, buses and PEs; `before`: the manager's first status."""
        found: list[Finding] = []
        survey = Survey(spec, {one.name: one for one in (*_own_bus(spec, before), *self.buses)})
        with ExitStack() as stack:
            found += survey.open(stack)
            running = RunningPlan.of(spec, before.plan).configuration
            inputs = WiredInputs(spec, running, _situation(before.status), set(survey.heard), time.monotonic_ns())
            seconds = max(self.seconds, inputs.patience_ns / 1e9 + _MARGIN_S)
            until_ns = inputs.begun_ns + round(seconds * 1e9)
            survey.listen(inputs, until_ns)
        status = status_now(self.socket).status
        found += [*manager_troubles(status), *_new_epoch(before.status, status)]
        found += [assess_key(status, self.key), assess_contingencies(status, spec, self.named)]
        found += [*survey.findings(seconds), *_pes(status, survey)]
        found += [*code_troubles(status), *element_troubles(status)]
        if spec.manager.bus in survey.heard and status["epoch"] == before.status["epoch"]:  # else others should send
            found += [*inputs.findings(until_ns, silent_data(status)), *silence_troubles(status, inputs.wired)]
        else:
            found += silence_troubles(status)
        return [*found, *function_troubles(status)]


def _as_flown(spec: Spec, status: Mapping[str, Any]) -> Spec:
    """Return the spec with longer heartbeats, if the manager flies with longer ones, as a demo does."""
    period_ns = status["manager"].get("heartbeat_ns", 0)
    return with_heartbeat(spec, period_ns) if period_ns > spec.buses[spec.manager.bus].heartbeat_ns else spec


def _computer(spec: Spec, told: Status) -> Iterator[Finding]:
    yield from assess_computer(needs_can=told.bus.interface == "socketcan")
    late_ns = latest_wake_up_ns(1, _REHEARSAL_S)
    yield assess_wake_ups(late_ns, spec.buses[spec.manager.bus].heartbeat_ns)
    yield assess_date(time.time(), files_of(told.status))
    folder = journal_folder(told.status)
    if folder is not None:
        yield assess_disk(folder)


def _own_bus(spec: Spec, told: Status) -> Iterator[BusChoice]:
    """Return the bus on which the manager is; none if only the manager's can.conf names its channel."""
    place = told.bus
    if place.channel and " " not in place.interface:
        bus = spec.buses[place.name]
        bitrate = bus.bitrate if place.interface == "softbus" and bus.kind != "wireless" else None
        yield BusChoice(bus.name, place.interface, place.channel, bitrate, is_ours=False, channels=bus.channels)


def _situation(status: Mapping[str, Any]) -> Situation:
    """Return the situation as the manager knows it, as far as routes of data depend on it."""
    down = {f"pe:{name}" for name, pe in status["pes"].items() if pe["state"] in ("down", "returning")}
    limits = {f"bus:{bus}": Fraction(link["limit"], 1000) for bus, link in status["links"].items()}
    return Situation(frozenset(down | {fault["element"] for fault in status["latched"]}), limits, status["phase"])


def _new_epoch(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Finding]:
    if before["epoch"] != after["epoch"]:
        yield Finding("epoch", f"epoch {after['epoch']} has begun while this command listened", "repeat it in a moment")


def _pes(status: Mapping[str, Any], survey: Survey) -> Iterator[Finding]:
    """Return findings about PEs and their tables; a PE that is not heard, or has another table, is named for that."""
    unheard, strangers = survey.pes_unheard(), set[str]()
    for finding, of_other_tables in survey.tables():
        strangers |= of_other_tables
        yield finding
    fit = []
    for pe in status["pes"]:
        known = list(standing_troubles(status, pe))
        if pe in unheard:
            why = "" if status["pes"][pe]["why"] is None else f": {status['pes'][pe]['why']}"
            yield Finding("PE", f"{pe} is not heard{why}", unheard[pe])
        elif pe in strangers:
            pass
        elif known:
            yield from known
        else:
            fit.append(pe)
    if fit:
        yield Finding("PE", f"{len(fit)} of {len(status['pes'])} run epoch {status['epoch']}: {', '.join(fit)}")
