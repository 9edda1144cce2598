"""Turns a recording of a flight with a key into a recording without a key, for the core that replays.

That core has no key, because its own nonces and command numbers would differ from the recorded ones. So this file keeps
only the frames of PEs and managers that the key proves. `Authenticity` decides which frames these are, as in a standby
manager. The sessions are those that the recorded WELCOMEs have opened. Each frame is treated by its kind:

    a command          is placed at the time of its TAG; a command that is never proven is left out
    a TAG              is left out
    pages 0 and 1      carry a tag in the place of the digest; if the tag is right, the digest is put back; if the tag
                       is wrong, the page is left out
    pages 2 and 3      are left out
    an EMCY            is placed after the page 0 that proves it, and left out without proof; an EMCY about a channel is
                       kept, since it needs no proof
    any other frame    is kept

A manager that has restarted does not know the sessions from before its restart. So in the flight it cannot authenticate
states of such a session, but here these states count. A PE may therefore become available in the replay a few periods
sooner than in the flight.
"""

from collections.abc import Iterable, Iterator, Sequence

from heronry_dg.model import Spec
from heronry_manager.core.authentication import Authenticity
from heronry_manager.core.turn import Turn
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame, LoggedFrame, Malformed
from heronry_wire.identifiers import FIRST_MANAGER, MANAGER_NODES, Command, emcy_id, management_id, state_id
from heronry_wire.management import ElementKind, Emergency, Lease, Prepare, decode_command, decode_emergency
from heronry_wire.sansio import Received
from heronry_wire.state_frames import StatePage0, StatePage1, decode_state

_TAG_IDS = frozenset(management_id(manager, Command.TAG) for manager in MANAGER_NODES)


def is_tagged(frames: Iterable[LoggedFrame]) -> bool:
    """Tell whether a recording is of a flight with a key."""
    return any(logged.frame.can_id in _TAG_IDS and not logged.frame.extended for logged in frames)


def proven(spec: Spec, key: Key, frames: Sequence[LoggedFrame]) -> list[LoggedFrame]:
    """Return the frames that are proven or need no proof, in the order in which this is decided.

    Commands, pages and EMCYs are changed or left out as the head of this file says.
    """
    reader = _Reader(spec, key)
    return [logged._replace(frame=frame) for logged in frames for frame in reader.read(logged)]


class _Reader:
    """Decides for each frame of both managers and of all PEs whether the key proves it."""

    def __init__(self, spec: Spec, key: Key) -> None:
        self._turn = Turn(FIRST_MANAGER, 0, term=0, silent=True)
        self._digests: dict[int, int] = {}  # by epoch, as the managers have announced them
        self._authenticity = Authenticity(spec, self._turn, key, digest_of=self._digests.get, speaks=lambda: False)
        self._states = {state_id(pe.node_id): pe for pe in spec.pes.values()}
        self._emergencies = {emcy_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._commands = {
            management_id(node, command): (node, command) for node in MANAGER_NODES for command in Command
        }

    def read(self, logged: LoggedFrame) -> list[Frame]:
        """Read the next frame; return the frames that it proves, or the frame itself if it needs no proof."""
        frame = logged.frame
        self._turn.now_ns = logged.time_ns
        if frame.extended or frame.remote or frame.error:
            return [frame]
        if frame.can_id in self._states:
            found = list(self._state(frame))
        elif frame.can_id in self._emergencies:
            found = self._emergency(frame)
        elif frame.can_id in self._commands:
            found = self._command(*self._commands[frame.can_id], frame)
        else:
            found = [frame]
        self._turn.end()  # events for the core are not needed here
        return found

    def _state(self, frame: Frame) -> Iterator[Frame]:
        pe, page = self._states[frame.can_id], decode_state(frame.data)
        if isinstance(page, Malformed):
            return
        believed = self._authenticity.believed(pe.name, page, frame.data)
        if isinstance(believed, StatePage0 | StatePage1):
            yield Frame(frame.can_id, believed.encode())
        emergency = self._authenticity.take_emergency(pe.name)
        if emergency is not None:
            yield Frame(emcy_id(pe.node_id), emergency)

    def _emergency(self, frame: Frame) -> list[Frame]:
        emergency = decode_emergency(frame.data)
        if isinstance(emergency, Emergency) and emergency.kind is ElementKind.CHANNEL:
            return [frame]  # reports of channels need no proof: no decision depends on them
        self._authenticity.hold_emergency(self._emergencies[frame.can_id], frame.data)
        return []

    def _command(self, node: int, command: Command, frame: Frame) -> list[Frame]:
        if command is not Command.TAG:
            if command is Command.CONTROL:
                self._authenticity.overhear(node, frame.data)
            self._authenticity.hold(node, command, Received(0, frame))
            return []
        found = self._authenticity.proven(node, frame.data)
        if found is None:
            return []
        message = decode_command(found.command, found.event.frame.data)
        if isinstance(message, Prepare | Lease):
            self._digests[message.epoch] = message.digest
        return [found.event.frame]
