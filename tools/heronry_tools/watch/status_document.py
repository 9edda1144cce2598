"""Fills a snapshot with the content of a manager's status (`heronry_manager.core.reports.status`)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from heronry_manager.events import Status as StatusEvent
from heronry_tools.watch.snapshot import Bus, Fault, Manager, Module, Pe, Script, Snapshot

_STAGES: Mapping[str | None, Any] = {None: "starting", "done": "running"}


def from_status(snapshot: Snapshot, event: StatusEvent) -> Snapshot:
    """Return the snapshot with the content of a `status` event; facts that only other events give stay unchanged."""
    status, t_ns = event.status, event.t_ns
    manager = status["manager"]
    keys = ("node", "term", "state", "advises", "key", "journal")
    return replace(
        snapshot,
        manager=Manager(**{key: manager[key] for key in keys}),
        phase=status["phase"],
        epoch=status["epoch"],
        next_epoch=status["next"],
        unknown_epoch=status["unknown_epoch"],
        stage="planning" if manager["planning"] else _STAGES.get(status["stage"], "activating"),
        priorities={name: one["priority"] for name, one in status["priorities"].items()},
        faults=tuple(
            Fault(one["element"], one["by"], one["code"], one["detail"], t_ns - one["for_ns"])
            for one in status["latched"]
        ),
        script=Script(**status["script"]),
        pes={name: _pe(pe, status["pes"][name]) for name, pe in snapshot.pes.items()},
        buses={name: _bus(name, bus, status) for name, bus in snapshot.buses.items()},
        modules=_modules(snapshot.modules, status["failures"]),
    )


def _pe(before: Pe, told: Mapping[str, Any]) -> Pe:
    standstills = told["standstills"]
    return replace(
        before,
        standing=told["state"],
        why=told["why"],
        epoch=told["epoch"],
        runs=told["runs"],
        stood_still=before.stood_still if standstills is None else standstills["long_times"],
    )


def _bus(name: str, before: Bus, status: Mapping[str, Any]) -> Bus:
    link = status["links"].get(name)
    share = None
    if link is not None:
        share = "gone" if link["state"] == "gone" else None if link["limit"] >= 1000 else f"{link['limit'] / 10:g}%"
    channels = {channel: tuple(status["channels"].get(channel, ())) for channel in before.channels}
    return replace(before, link=share, channels=channels)


def _modules(before: Mapping[str, Module], failures: list[Mapping[str, Any]]) -> dict[str, Module]:
    texts = {one["element"].partition(":")[2]: one["text"] for one in failures}
    return {name: replace(module, failure=texts.get(name, module.failure)) for name, module in before.items()}
