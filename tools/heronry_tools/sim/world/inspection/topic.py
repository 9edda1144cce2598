"""The base class of the topics of an inspection. In an inspection, a diagnostic client checks one PE topic by topic.

A topic has the table of the PE, the frames that were heard of the PE, and an SDO client.
"""

from dataclasses import dataclass, field
from itertools import pairwise

from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.sdo_talk import SdoTalk, Talk, WrongAnswerError
from heronry_wire.canopen_objects import HEARTBEAT_MS
from heronry_wire.management import Lease
from heronry_wire.pe_table import PeTable
from heronry_wire.sdo import Abort
from heronry_wire.state_frames import StatePage0, StatePage1

MS = 1_000_000
SHORT_MS, SLOW_MS = 100, 250  # heartbeat times that are tried, in ms
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127  # states that a heartbeat reports


@dataclass(slots=True)
class Heard:
    """What was heard so far: heartbeats and pages 0 and 1 of the inspected PE, and the manager's last LEASE."""

    heartbeats: list[tuple[int, int]] = field(default_factory=list)  # time in ns, and the state reported
    pages_0: list[tuple[int, StatePage0]] = field(default_factory=list)
    pages_1: list[tuple[int, StatePage1]] = field(default_factory=list)
    lease: tuple[int, Lease] | None = None  # the manager's node-ID, and the last LEASE


class Topic:
    """Base of a topic, which is one part of an inspection; its methods are generators, like those of `SdoTalk`."""

    def __init__(self, clock: Clock, table: PeTable, heard: Heard) -> None:
        self._clock, self._table, self._heard = clock, table, heard
        self._node = table.node_id
        self._sdo = SdoTalk(table.node_id)

    def wait(self, ms: int) -> Talk[None]:
        """Wait for `ms` milliseconds."""
        yield None, -1, ms * MS

    def read(self, index: int, sub_index: int, wanted: bytes | int | Abort) -> Talk[None]:
        """Read an object and demand that it has the value `wanted`.

        wanted: the bytes; or a number, whatever the length of the object is; or the reason for which the PE must refuse
            to give the object
        """
        found = yield from self._sdo.upload(index, sub_index)
        same = wanted == (
            int.from_bytes(found, "little") if isinstance(wanted, int) and isinstance(found, bytes) else found
        )
        demand(same, f"object {index:04X}h, {sub_index} reads {found!r}, not {wanted!r}")

    def beats_every(self, time_ms: int) -> Talk[None]:
        """Demand that from now on the heartbeat comes with this period, or does not come if the period is 0."""
        self._heard.heartbeats.clear()
        begun_ns = self._clock.now_ns
        yield from self.wait(4 * time_ms + 20 if time_ms < HEARTBEAT_MS else HEARTBEAT_MS + 20)
        times = [t for t, _ in self._heard.heartbeats]
        if time_ms == 0:
            demand(times == [], "a heartbeat of 0 ms is heard")
            return
        gaps = [later - earlier for earlier, later in pairwise(times)]
        demand(all(abs(gap - time_ms * MS) < 3 * MS for gap in gaps), f"the heartbeat comes after {gaps} ns")
        demand(
            bool(times) and times[0] - begun_ns <= (time_ms + 3) * MS, f"the heartbeat of {time_ms} ms does not come"
        )


def demand(holds: bool, story: str) -> None:
    """Raise WrongAnswerError with the sentence `story` if `holds` is False; the error ends the inspection."""
    if not holds:
        raise WrongAnswerError(story)
