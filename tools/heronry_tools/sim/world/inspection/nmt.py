"""The part of an inspection about CANopen NMT and the heartbeat of a PE (CiA 301, 7.2.8).

In flight the PE must refuse every NMT command. On a desk it must execute each command that is addressed to it. The
heartbeat time can be set in both cases.
"""

from heronry_tools.sim.world.inspection.topic import (
    BOOT_UP,
    MS,
    OPERATIONAL,
    PRE_OPERATIONAL,
    SHORT_MS,
    SLOW_MS,
    STOPPED,
    Topic,
    demand,
)
from heronry_tools.sim.world.sdo_talk import Talk
from heronry_wire.canopen_objects import DEVICE_NAME, HEARTBEAT_MS, HEARTBEAT_TIME, STORED_EDS
from heronry_wire.frame import Frame
from heronry_wire.identifiers import NMT_ID
from heronry_wire.node_services import BROADCAST
from heronry_wire.sdo import SEGMENT_UPLOAD, UPLOAD, Abort, segment, with_data

_START, _STOP, _ENTER_PRE_OPERATIONAL, _RESET, _RESET_COMMUNICATION = 1, 2, 128, 129, 130
_WAIT_NS = 100 * MS


class Nmt(Topic):
    """Sends NMT commands to the PE, and verifies its heartbeat."""

    def heartbeat_time(self) -> Talk[None]:
        """Demand that the heartbeat comes with the period in object 1017h, and does not come if the period is 0."""
        for time_ms in (SHORT_MS, 0, SLOW_MS, HEARTBEAT_MS):
            found = yield from self._sdo.download(HEARTBEAT_TIME, 0, time_ms.to_bytes(2, "little"))
            demand(found is None, f"a heartbeat time of {time_ms} ms is refused: {found}")
            yield from self.read(HEARTBEAT_TIME, 0, time_ms)
            yield from self.beats_every(time_ms)

    def in_flight(self) -> Talk[None]:
        """Demand that the PE executes no NMT command: its heartbeat continues, and reports an operational PE."""
        for command in (_STOP, _ENTER_PRE_OPERATIONAL, _RESET, _RESET_COMMUNICATION, _START, 77):
            for node in (self._node, BROADCAST):
                yield Frame(NMT_ID, bytes((command, node))), -1, 2 * MS
        yield Frame(NMT_ID, bytes((_STOP,))), -1, 2 * MS
        self._heard.heartbeats.clear()
        yield from self.wait(HEARTBEAT_MS + 20)
        states = {value for _, value in self._heard.heartbeats}
        demand(states == {OPERATIONAL}, f"after NMT commands in flight the heartbeat reports states {states}")

    def on_a_desk(self) -> Talk[None]:
        """Demand that the PE executes each known NMT command that is addressed to it, and no other command."""
        yield from self._sdo.download(HEARTBEAT_TIME, 0, SHORT_MS.to_bytes(2, "little"))
        yield from self._commanded(_START, self._node, [OPERATIONAL])
        yield from self._commanded(_STOP, self._node + 1, [OPERATIONAL])
        yield from self._commanded(77, self._node, [OPERATIONAL])
        yield from self._commanded(_STOP, self._node, [STOPPED])
        yield from self._sdo.say(with_data(UPLOAD, DEVICE_NAME, 0), _WAIT_NS)
        yield from self._commanded(_ENTER_PRE_OPERATIONAL, BROADCAST, [PRE_OPERATIONAL])
        yield from self.read(DEVICE_NAME, 0, b"heronry PE")
        for reset in (_RESET, _RESET_COMMUNICATION):
            yield from self._sdo.download(HEARTBEAT_TIME, 0, SHORT_MS.to_bytes(2, "little"))
            yield from self.wait(SHORT_MS)
            yield from self._sdo.ask(with_data(UPLOAD, STORED_EDS, 0))
            yield from self._commanded(reset, self._node, [BOOT_UP])
            yield from self._sdo.refused(segment(SEGMENT_UPLOAD, b""), Abort.COMMAND)
            yield from self.read(HEARTBEAT_TIME, 0, HEARTBEAT_MS)
            yield from self._commanded(_ENTER_PRE_OPERATIONAL, self._node, [PRE_OPERATIONAL], HEARTBEAT_MS)

    def _commanded(self, command: int, node: int, states: list[int], time_ms: int = SHORT_MS) -> Talk[None]:
        self._heard.heartbeats.clear()
        yield Frame(NMT_ID, bytes((command, node))), -1, (time_ms + 10) * MS
        heard = [value for _, value in self._heard.heartbeats]
        demand(heard == states, f"after NMT command {command} to {node} the heartbeat reports {heard}, not {states}")
