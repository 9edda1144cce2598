"""Faults of radios and channels in flights of real processes: what the simulator does to a bus, done to its hub.

    omission bus:B level N      receivers miss N frames in a thousand
    collapse bus:B level N      bits take N times longer
    link_cut bus:B              nothing passes any more
    channel_loss channel:B.N    the same, of one channel of a replicated bus

What is done to a bus at a moment follows from the script and the time alone. Where several faults overlap, the worst
counts; with the last one the radio is a good one again.
"""

from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import NamedTuple, Self

from can.typechecking import CanFilters

from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.sim.scenario.script import Deed

KINDS = ("omission", "collapse", "link_cut", "channel_loss")
_NS_PER_MS = 1_000_000
_NOTHING: CanFilters = [{"can_id": 0x7FF, "can_mask": 0x7FF, "extended": False}]


class Disturbance(NamedTuple):
    """How much slower a bus is than it should be, and how many frames of a thousand receivers miss."""

    slowdown: int = 1
    loss_per_mille: int = 0


def disturbance(faults: Iterable[Deed], elapsed_ns: int) -> Disturbance:
    """Disturbance of one bus at a time of the script, in ns."""
    levels = dict.fromkeys(KINDS, 0) | {"collapse": 1}
    for deed in faults:
        fault = deed.fault
        assert fault is not None
        if deed.at_ns <= elapsed_ns and (not fault.lasts_ms or elapsed_ns < deed.at_ns + fault.lasts_ms * _NS_PER_MS):
            levels[fault.kind] = max(levels[fault.kind], fault.level or 1)
    return Disturbance(levels["collapse"], 1000 if levels["link_cut"] or levels["channel_loss"] else levels["omission"])


class BadRadios:
    """The radios of one flight; as a context manager it closes its connections to them at the end."""

    def __init__(self, deeds: Iterable[Deed], channels: Mapping[str, str]) -> None:
        """`channels` are the paths of hubs, by the name of the bus or of its channel; others are left alone."""
        self._faults: dict[str, list[Deed]] = {}
        for deed in deeds:
            if deed.fault is not None:
                self._faults.setdefault(deed.fault.name, []).append(deed)
        self._clients = {bus: SoftBus(channels[bus], can_filters=_NOTHING) for bus in self._faults}
        self._now = dict.fromkeys(self._faults, Disturbance())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for client in self._clients.values():
            client.shutdown()

    def next_ns(self, elapsed_ns: int) -> int | None:
        """Time of the script, in ns, at which something changes next; None where nothing does."""
        times = [
            time_ns
            for deeds in self._faults.values()
            for deed in deeds
            if deed.fault is not None
            for time_ns in (deed.at_ns, deed.at_ns + deed.fault.lasts_ms * _NS_PER_MS)
            if time_ns > elapsed_ns
        ]
        return min(times, default=None)

    def follow(self, elapsed_ns: int) -> None:
        """Disturb the radios as the script has it at this time."""
        for bus, deeds in self._faults.items():
            wanted = disturbance(deeds, elapsed_ns)
            if wanted != self._now[bus]:
                self._now[bus] = wanted
                self._clients[bus].disturb(slowdown=wanted.slowdown, loss_per_mille=wanted.loss_per_mille)
