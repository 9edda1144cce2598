"""Fills a snapshot with the content of a manager's status (`heronry_manager.core.reports.manager_status`).

A status may come from a recording, which may be damaged. So its form is checked before it is used; of a status of
another form nothing is used.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from heronry_manager.events import Status as StatusEvent
from heronry_tools.watch.snapshot import (
    Bus,
    Fault,
    Manager,
    Module,
    Pe,
    Script,
    Silence,
    Snapshot,
    Stage,
    Standing,
    Stranger,
    Transfer,
)
from heronry_wire.node_cost import NodeCost
from heronry_wire.node_offer import adopts, hardware, read_offer

_STAGES: Mapping[str | None, Stage] = {None: "starting", "done": "running"}


@dataclass(frozen=True, slots=True)
class _Manager:
    node: int
    term: int
    state: str
    advises: bool
    planning: bool
    key: str | None
    journal: str | None


@dataclass(frozen=True, slots=True)
class _Standstills:
    long_times: int


@dataclass(frozen=True, slots=True)
class _Pe:
    state: Standing
    why: str | None
    epoch: int | None
    runs: str
    standstills: _Standstills | None
    cost: NodeCost | None = None


@dataclass(frozen=True, slots=True)
class _Priority:
    priority: int


@dataclass(frozen=True, slots=True)
class _Latched:
    element: str
    by: str
    code: str
    detail: int
    for_ns: int


@dataclass(frozen=True, slots=True)
class _Failure:
    element: str
    text: str


@dataclass(frozen=True, slots=True)
class _Link:
    state: str
    limit: int


@dataclass(frozen=True, slots=True)
class _Silence:
    module: str
    by: str
    what: Literal["input", "output"]
    variable: str
    producer: str | None
    for_ns: int


@dataclass(frozen=True, slots=True)
class _Script:
    state: str
    why: str | None


@dataclass(frozen=True, slots=True)
class _Progress:
    pe: str
    bytes: int
    of: int


@dataclass(frozen=True, slots=True)
class _Unknown:
    node: int
    says: str
    offer: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class _Status:
    """What is used of a status."""

    manager: _Manager
    phase: str | None
    epoch: int | None
    next: int | None
    unknown_epoch: int | None
    stage: str | None
    priorities: dict[str, _Priority]
    latched: list[_Latched]
    script: _Script
    pes: dict[str, _Pe]
    links: dict[str, _Link]
    channels: dict[str, list[str]]
    failures: list[_Failure]
    silences: list[_Silence] = field(default_factory=list)  # an older manager tells none
    tables: dict[str, str] = field(default_factory=dict)
    code: dict[str, str] = field(default_factory=dict)
    transfers: list[_Progress] = field(default_factory=list)
    unknown_nodes: list[_Unknown] = field(default_factory=list)


@cache
def _form() -> TypeAdapter[_Status]:
    """Make what checks the form of a status; that is slow, so it is done once, and only if there is a status."""
    return TypeAdapter(_Status)


def from_status(snapshot: Snapshot, event: StatusEvent) -> Snapshot | None:
    """Return the snapshot with the content of a `status` event; facts that only other events give stay unchanged.

    Returns None if the status is of another form.
    """
    try:
        status = _form().validate_python(event.status)
    except ValidationError:
        return None
    t_ns, manager = event.t_ns, status.manager
    return replace(
        snapshot,
        manager=Manager(manager.node, manager.term, manager.state, manager.advises, manager.key, manager.journal),
        phase=status.phase,
        epoch=status.epoch,
        next_epoch=status.next,
        unknown_epoch=status.unknown_epoch,
        stage="planning" if manager.planning else _STAGES.get(status.stage, "activating"),
        priorities={name: one.priority for name, one in status.priorities.items()},
        faults=tuple(Fault(one.element, one.by, one.code, one.detail, t_ns - one.for_ns) for one in status.latched),
        silences=tuple(
            Silence(one.module, one.by, one.what, one.variable, one.producer, t_ns - one.for_ns)
            for one in status.silences
        ),
        transfers=tuple(_transfers(status)),
        strangers=tuple(_stranger(snapshot.spec, one) for one in status.unknown_nodes),
        script=Script(status.script.state, status.script.why),
        pes={name: _pe(pe, status.pes.get(name)) for name, pe in snapshot.pes.items()},
        buses={name: _bus(name, bus, status) for name, bus in snapshot.buses.items()},
        modules=_modules(snapshot.modules, status.failures),
    )


def _transfers(status: _Status) -> Iterator[Transfer]:
    percents = {one.pe: 100 * one.bytes // max(1, one.of) for one in status.transfers}
    for pe, says in status.tables.items():
        yield Transfer(pe, "table", says, percents.get(pe))
    for pe, says in status.code.items():
        yield Transfer(pe, "code", says, percents.get(pe))


def _stranger(spec: str, told: _Unknown) -> Stranger:
    offer = None if told.offer is None else read_offer(json.dumps(told.offer))  # a recording may be damaged
    if offer is None:
        return Stranger(told.node, told.says)
    return Stranger(told.node, told.says, hardware(offer), tuple(offer["images"]), adopts(spec, told.node))


def _pe(before: Pe, told: _Pe | None) -> Pe:
    if told is None:
        return before
    return replace(
        before,
        standing=told.state,
        why=told.why,
        epoch=told.epoch,
        runs=told.runs,
        stood_still=before.stood_still if told.standstills is None else told.standstills.long_times,
        cost=before.cost if told.cost is None else told.cost,
    )


def _bus(name: str, before: Bus, status: _Status) -> Bus:
    link = status.links.get(name)
    share = None
    if link is not None:
        share = "gone" if link.state == "gone" else None if link.limit >= 1000 else f"{link.limit / 10:g}%"
    channels = {channel: tuple(status.channels.get(channel, ())) for channel in before.channels}
    return replace(before, link=share, channels=channels)


def _modules(before: Mapping[str, Module], failures: list[_Failure]) -> dict[str, Module]:
    texts = {one.element.partition(":")[2]: one.text for one in failures}
    return {name: replace(module, failure=texts.get(name, module.failure)) for name, module in before.items()}
