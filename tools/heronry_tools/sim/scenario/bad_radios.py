"""Faults of radios and channels in flights of real processes: the hub of a software bus disturbs the bus.

    omission bus:B level N      receivers miss N of a thousand frames
    collapse bus:B level N      each bit takes N times as long
    link_cut bus:B              no frame passes
    channel_loss channel:B.N    no frame passes on one channel of a replicated bus

The disturbance at a moment depends only on the script and the time. Where several faults overlap, the worst one counts;
after the last one ends, the bus is undisturbed again.
"""

from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import NamedTuple, Self

from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.sim.scenario.script import Deed
from heronry_wire.bare_can import can

KINDS = ("omission", "collapse", "link_cut", "channel_loss")
_NS_PER_MS = 1_000_000
_NOTHING: can.typechecking.CanFilters = [{"can_id": 0x7FF, "can_mask": 0x7FF, "extended": False}]


class Disturbance(NamedTuple):
    """How many times slower than normal a bus is, and how many of a thousand frames its receivers miss."""

    slowdown: int = 1
    loss_per_mille: int = 0


def disturbance(faults: Iterable[Deed], elapsed_ns: int) -> Disturbance:
    """Return how a bus is disturbed at a time of the script (ns).

    faults: the deeds that inject faults into this bus, at any time.
    """
    levels = dict.fromkeys(KINDS, 0) | {"collapse": 1}
    for deed in faults:
        fault = deed.fault
        assert fault is not None
        if deed.at_ns <= elapsed_ns and (not fault.lasts_ms or elapsed_ns < deed.at_ns + fault.lasts_ms * _NS_PER_MS):
            levels[fault.kind] = max(levels[fault.kind], fault.level or 1)
    return Disturbance(levels["collapse"], 1000 if levels["link_cut"] or levels["channel_loss"] else levels["omission"])


class BadRadios:
    """Disturbs, during one flight, the buses and channels into which the deeds of this flight inject a fault.

    It is a context manager: at the end of the block the connections to the hubs are closed.
    """

    def __init__(self, deeds: Iterable[Deed], channels: Mapping[str, str]) -> None:
        """Connect to the hubs of all buses and channels into which `deeds` inject a fault.

        channels: path of the hub of each of these buses or channels, by name
        """
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
        """Return the time of the script (ns) at which a disturbance changes next; None if none does."""
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
        """Disturb each bus as the script demands at the time `elapsed_ns` of the script."""
        for bus, deeds in self._faults.items():
            wanted = disturbance(deeds, elapsed_ns)
            if wanted != self._now[bus]:
                self._now[bus] = wanted
                self._clients[bus].disturb(slowdown=wanted.slowdown, loss_per_mille=wanted.loss_per_mille)
