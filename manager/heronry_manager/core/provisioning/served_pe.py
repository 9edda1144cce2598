"""The SDO client of the PE that is being brought something: it reads and writes there, at the pace of what runs.

    free       this client serves no PE
    reading    an object of the PE is being read
    writing    one part of a value is on its way to the PE
    waiting    something is due at a later time: a write after its UNLOCK, another look at the PE

Who brings something begins with a PE (`begin`), gives steps (`read`, `bring`, `write`, `later`), each with what
follows, and ends (`end`). A step that fails is told to it (`failed`), and it draws the consequences.

*In parts.* What has many bytes goes out in parts (`part_transfer`). First the PE is asked how much of this whole it has
already, so a transfer goes on after an interruption, also by another manager that brings the same bytes. An
interruption costs at most the part that was on its way.

*Pauses.* After each failure the pause of a PE doubles, from SHORTEST_PAUSE_NS to LONGEST_PAUSE_NS (`pause`); the one
who brings says what ends this count (`is_well`).

*Pace.* Requests use a tenth of the bus, or so much less that nothing that runs misses its deadline (`pace`). If no pace
is slow enough, the step fails. While another configuration is on its way, no segment is sent. A PE drops its client
after a second without a segment; then the part fails.

With a key each write follows an UNLOCK.

A lost, late, doubled or forged answer ends a step, or makes it fail. A restart forgets everything here.
"""

from collections.abc import Callable, Iterable
from hashlib import sha256
from typing import Any

from heronry_dg.model import Pe
from heronry_manager.core.epochs import Deployment
from heronry_manager.core.provisioning.pace import Pace
from heronry_manager.core.sdo_client import BlockDownload, ObjectReader, OneServed, Outcome
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation import KnownSituation
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, sdo_request_id, sdo_response_id
from heronry_wire.management import Control, Operation
from heronry_wire.part_transfer import Part, Received, Transfer
from heronry_wire.sansio import Send
from heronry_wire.sdo import read_number

SHORTEST_PAUSE_NS, LONGEST_PAUSE_NS = 1_000_000_000, 64_000_000_000
FOR_ANOTHER_NS = 2_000_000_000  # the PE drops the transfer of a silent client after one second
_UNLOCK_S = 5  # a part that has begun may end after that time
_AFTER_UNLOCK_NS = 20_000_000  # the TAG of the UNLOCK is on the bus, and the PE has checked it
_NO_ROOM = "beside what runs the bus has no room for it"
_SILENT = "it did not answer"

Failed = Callable[[str, Outcome, str], None]
"""What to do when a step fails: with the PE, how it failed, and why."""


class ServedPe:
    """Serves one PE at a time; `next_ns` is the time in ns at which to call `tick`, while a PE is served."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        *,
        deployment: Deployment,
        situation: KnownSituation,
        served: OneServed,
        failed: Failed,
    ) -> None:
        """Begin with no PE; `failed` must end the service of the PE (`end`, `pause`)."""
        self._turn, self._key, self._served, self._failed = turn, settings.key, served, failed
        self._pace, self._beat_ns = Pace(settings.spec, deployment, situation), settings.bus.heartbeat_ns
        self._reader = ObjectReader(turn.do)
        self.pe: str | None = None
        self.began_ns = 0
        self.at, self.of = 0, 0  # bytes of the whole that the PE has, and of the whole
        self._node: dict[str, int] = {}
        self._pe_of_answer: dict[int, str] = {}
        self._pe_of_request: dict[int, str] = {}
        self._transfer: BlockDownload | None = None
        self._then: Callable[[], None] | None = None  # what follows when the present write is over
        self._due: tuple[int, Callable[[], None]] | None = None  # what is done next, and when
        self._not_before_ns: dict[str, int] = {}
        self._tries: dict[str, int] = {}  # failures of a PE since it was well

    def may_serve(self, pes: Iterable[Pe]) -> list[Pe]:
        """Note the PEs that may be served; returns those to which there is a way."""
        here = [pe for pe in pes if self._pace.way(pe.name)]
        self._node = {pe.name: pe.node_id for pe in here}
        self._pe_of_answer = {sdo_response_id(pe.node_id): pe.name for pe in here}
        self._pe_of_request = {sdo_request_id(pe.node_id): pe.name for pe in here}
        return here

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return identifier in self._pe_of_answer or identifier in self._pe_of_request

    def asked_by_another(self, frame: Frame) -> str | None:
        """Return the PE to which another SDO client has sent this frame; None: it is none of these."""
        return self._pe_of_request.get(frame.can_id)

    def is_held(self) -> bool:
        """Tell whether no frame of a transfer may be sent now."""
        return self._pace.is_held()

    # The service of one PE

    def begin(self, pe: str) -> bool:
        """Serve a PE from now on; False: another one is served, or something is being read from this one."""
        if not self._served.begin(self._node[pe], self._turn.now_ns):
            return False
        self.pe, self.began_ns, self.at, self.of = pe, self._turn.now_ns, 0, 0
        return True

    def end(self, *, abort: bool = False) -> None:
        """Serve no PE any more; abort: and tell it so, if something is being written."""
        if abort and self._transfer is not None:
            self._transfer.stop()
        if self.pe is not None:
            self._served.end(self._turn.now_ns)
        self.pe, self._transfer, self._then, self._due = None, None, None, None
        self._reader.give_up()

    def not_before_ns(self, pe: str) -> int:
        """Return the time in ns before which nothing is to be brought to a PE; 0: it has no pause."""
        return self._not_before_ns.get(pe, 0)

    def tries(self, pe: str) -> int:
        """Return how often a PE was paused since it was well."""
        return self._tries.get(pe, 0)

    def put_off(self, pe: str, pause_ns: int) -> None:
        """Bring nothing to a PE for this time, in ns; the count of its pauses stays."""
        self._not_before_ns[pe] = max(self.not_before_ns(pe), self._turn.now_ns + pause_ns)

    def pause(self, pe: str) -> None:
        """Bring nothing to a PE for twice as long as the last time."""
        before = self._tries.get(pe, 0)
        self._tries[pe] = before + 1
        self.put_off(pe, min(SHORTEST_PAUSE_NS << min(before, 16), LONGEST_PAUSE_NS))

    def is_well(self, pe: str) -> None:
        """Begin the count of a PE's pauses anew."""
        self._tries.pop(pe, None)

    def forget(self) -> None:
        """Forget all pauses."""
        self._tries.clear()
        self._not_before_ns.clear()

    def progress(self) -> dict[str, Any] | None:
        """Return what is on its way as plain data: pe, bytes that it has, and of how many; None: nothing is."""
        return {"pe": self.pe, "bytes": self.at, "of": self.of} if self.pe is not None and self.of else None

    # Steps

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`."""
        if self._transfer is not None:
            return self._transfer.next_ns
        return self._reader.next_ns if self._due is None else self._due[0]

    def heard(self, frame: Frame) -> None:
        """Process an SDO answer; that of a PE which is not served is dropped."""
        if self.pe is None or self._pe_of_answer.get(frame.can_id) != self.pe:
            return
        if self._transfer is None:
            self._reader.heard(self._node[self.pe], frame.data, self._turn.now_ns)
        else:
            self._transfer.heard(frame.data, self._turn.now_ns)
            self._look_at(self._transfer)

    def tick(self) -> None:
        """Do what is due."""
        if self._transfer is not None:
            self._send_segment(self._transfer)
        elif self._due is None:
            self._reader.tick(self._turn.now_ns)
        elif self._turn.now_ns >= self._due[0]:
            (_, act), self._due = self._due, None
            act()

    def later(self, after_ns: int, act: Callable[[], None]) -> None:
        """Do something in `after_ns` ns, if the PE is still served then."""
        self._due = self._turn.now_ns + after_ns, act

    def read(self, index: int, sub_index: int, take: Callable[[bytes], None]) -> None:
        """Read an object; `take` is called with its value."""
        pe = self._served_pe()

        def took(value: bytes | None) -> None:
            if self.pe is None:
                return  # the service was ended, and its reader with it
            if value is None:
                self._failed(pe, Outcome.FAILED, _SILENT)
            else:
                take(value)

        self._reader.read(self._node[pe], index, sub_index, took, self._turn.now_ns)

    def read_number(self, index: int, sub_index: int, take: Callable[[int], None]) -> None:
        """Read an object that is a number; `take` is called with its value."""
        pe = self._served_pe()

        def took(value: bytes) -> None:
            number = read_number(value)
            if number is None:
                self._failed(pe, Outcome.FAILED, _SILENT)
            else:
                take(number)

        self.read(index, sub_index, took)

    def bring(self, index: int, content: bytes, part_bytes: int, then: Callable[[], None]) -> None:
        """Write what the PE lacks of `content` into an object that takes parts; `then` follows.

        part_bytes: bytes of each part but the last.
        """
        if self._period_ns() is None:
            return
        self.of = len(content)
        transfer = Transfer(sha256(content).digest(), len(content))

        def received(value: bytes) -> None:
            known = Received.decode(value)
            is_this = known is not None and known.digest == transfer.digest and known.length < len(content)
            self.at = known.length if known is not None and is_this else 0
            send_part()

        def send_part() -> None:
            at = self.at
            if at >= len(content):
                then()
                return
            end = min(at + part_bytes, len(content))

            def sent() -> None:
                self.at = end
                send_part()

            self.write(index, Part(transfer, at, content[at:end]).encode(), sent)

        self.read(index, 2, received)

    def write(self, index: int, content: bytes, then: Callable[[], None]) -> None:
        """Write sub-index 1 of an object, after an UNLOCK if there is a key; `then` follows."""
        if self._key is None:
            self._open(index, content, then)
            return
        unlock = Control(self._turn.term, self._node[self._served_pe()], Operation.UNLOCK, _UNLOCK_S)
        self._turn.send(Command.CONTROL, unlock)
        self.later(_AFTER_UNLOCK_NS, lambda: self._open(index, content, then))

    def _served_pe(self) -> str:
        assert self.pe is not None
        return self.pe

    def _period_ns(self) -> int | None:
        """Return the time in ns from one request to the next; None: there is no room, and the step has failed."""
        pe = self._served_pe()
        period_ns = self._pace.period_ns(pe)
        if period_ns is None:
            if self._transfer is not None:
                self._transfer.stop()
            self._failed(pe, Outcome.FAILED, _NO_ROOM)
        else:
            self._reader.segment_ns = period_ns
        return period_ns

    def _open(self, index: int, content: bytes, then: Callable[[], None]) -> None:
        request, period_ns = sdo_request_id(self._node[self._served_pe()]), self._period_ns()
        if period_ns is None:
            return
        self._then = then
        self._transfer = BlockDownload(
            index, content, period_ns, lambda said: self._turn.do(Send(0, Frame(request, said))), sub_index=1
        )
        self._transfer.begin(self._turn.now_ns)

    def _send_segment(self, transfer: BlockDownload) -> None:
        """Send the segment that is due, at the pace that what runs now allows."""
        now_ns, period_ns = self._turn.now_ns, self._period_ns()
        if period_ns is None:
            return
        transfer.segment_ns = period_ns
        if self._pace.is_held():
            transfer.put_off(now_ns + self._beat_ns)
        transfer.tick(now_ns)
        self._look_at(transfer)

    def _look_at(self, transfer: BlockDownload) -> None:
        """Draw the consequences if a write is over."""
        if transfer.outcome is Outcome.UNDER_WAY:
            return
        then, self._transfer, self._then = self._then, None, None
        assert then is not None
        if transfer.outcome is Outcome.TAKEN:
            then()
        else:
            self._failed(self._served_pe(), transfer.outcome, transfer.why)
