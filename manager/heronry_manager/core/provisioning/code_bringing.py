"""Brings code that a PE lacks, as a bundle in parts, and ends the fault that its lack was (protocol rule 10).

    lacking     a PE has reported that the code of a module is not there; the module's place counts as failed, so plans
                do without it. Of all these, the module of the highest criticality is served first
    asked       which bundle does the PE run (2030h sub 3), and how much of this one has it already (2030h sub 2)?
    sending     one part after the other (2030h sub 1), at the pace that what runs allows
    checking    the PE's loader works on the whole bundle (1F57h); then it is started (1F51h) and checked again
    arrived     the PE runs this bundle: the faults of all modules whose images the bundle holds are cleared on this
                PE, and the planner does the rest
    refused     the PE runs another bundle of this version, or a newer one: nothing is sent. Or it has refused the
                bundle (errors 6 and 7): it is brought it again only after it has restarted, or after the operator has
                cleared the fault
    paused      something has failed, or another SDO client has made a request to the PE. The pause doubles, and what
                the PE has of the bundle is not sent again

*Who may change it.* Only an active manager that may send brings code. What it brings was read from files at its start.
With a key each write follows an UNLOCK, and a report of lacking code counts only if it is proven.

*What may go wrong.* A lost, late or doubled answer ends a step, which is done again after the pause. A forged answer
can make a transfer fail, or clear a fault although the code is not there: the PE then reports the lack anew, before it
stages anything. A PE that restarts has forgotten the parts, and begins anew. Code that fails on the PE is taken back
there, and its version is refused from then on: this is told. A restart or takeover of
the manager forgets all this; the PEs report what they lack to each new manager.

A PE has one bundle in use, so two bundles would displace each other. It is brought only a bundle that holds all of its
images that come in bundles; if there is none, this is told.

One PE is served at a time, with a table or with code (`one_served`). Only PEs on the manager's own bus are served. No
decision on what runs depends on anything here but the clearing of those faults.
"""

from collections.abc import Callable
from hashlib import sha256

from heronry_dg.situation import hosts_when_all_is_up
from heronry_dg.traffic import criticality_ranks
from heronry_manager import events
from heronry_manager.core.epochs import Deployment
from heronry_manager.core.mastership import Claim
from heronry_manager.core.membership import Health
from heronry_manager.core.provisioning.pace import Pace
from heronry_manager.core.provisioning.table_bringing import FOR_ANOTHER_NS, LONGEST_PAUSE_NS, SHORTEST_PAUSE_NS
from heronry_manager.core.sdo_client import BlockDownload, ObjectReader, OneServed, Outcome
from heronry_manager.core.settings import CodeBundle, ManagerSettings
from heronry_manager.core.situation import KnownSituation, LatchedFault
from heronry_manager.core.turn import Turn
from heronry_wire.bundle_transfer import Part, Received, Transfer
from heronry_wire.canopen_objects import PROGRAM_CONTROL, PROGRAM_STATUS, PROGRAM_TRANSFER, PROGRAM_VERSION
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, sdo_request_id, sdo_response_id
from heronry_wire.management import Control, Operation
from heronry_wire.sansio import NEVER_NS, Send
from heronry_wire.sdo import read_number

PART_BYTES = 7000
LOOK_NS = 500_000_000
"""How often lacking code is looked for, and how often a loader at work is asked."""

_AFTER_JOINING_NS = 5_000_000_000  # the manager's other questions to a PE that has joined are answered
_MOST_LOOKS = 140  # a loader works for at most 70 s
_UNLOCK_S = 5
_AFTER_UNLOCK_NS = 20_000_000  # the TAG of the UNLOCK is on the bus, and the PE has checked it
_START = b"\x01"
_SILENT = "it did not answer"
_NO_ROOM = "beside what runs the bus has no room for it"
_FOR_GOOD = (6, 7)  # of these errors: the same bundle has the same answer until the PE restarts
_ERRORS = {
    3: "it does not take it, or not yet: its log says why",
    5: "its disk does not take it: its log says why",
    6: "it is too large for it: leave files out",
    7: "it is not for this PE (signature, version or Python), or code of it runs: its log says why",
}


class CodeBringing:
    """Brings bundles to PEs that lack code; `next_ns` is the time in ns at which to call `tick`."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        claim: Claim,
        health: Health,
        deployment: Deployment,
        *,
        situation: KnownSituation,
        served: OneServed,
    ) -> None:
        """Begin without a transfer; without `settings.bundles` nothing is ever brought."""
        self._spec, self._key, self._bundles = settings.spec, settings.key, settings.bundles
        self._turn, self._claim, self._health, self._situation = turn, claim, health, situation
        self._served = served
        self._pace, self._beat_ns = Pace(settings.spec, deployment, situation), settings.bus.heartbeat_ns
        here = [pe for pe in settings.spec.pes.values() if self._bundles and self._pace.way(pe.name)]
        self._node = {pe.name: pe.node_id for pe in here}
        self._pe_of_answer = {sdo_response_id(pe.node_id): pe.name for pe in here}
        self._pe_of_request = {sdo_request_id(pe.node_id): pe.name for pe in here}
        self._ranks = criticality_ranks(settings.spec) if here else {}
        self._reader = ObjectReader(turn.do)
        self._look_ns = turn.now_ns if here else NEVER_NS
        self._now: tuple[str, CodeBundle] | None = None
        self._began_ns = self._at = self._looks = 0
        self._transfer: BlockDownload | None = None
        self._then: Callable[[], None] | None = None  # what follows when the present write is over
        self._due: tuple[int, Callable[[], None]] | None = None  # what is done next, and when
        self._not_before_ns: dict[str, int] = {}
        self._tries: dict[str, int] = {}
        self._told: dict[str, str] = {}
        self._refused: dict[str, int | None] = {}  # by PE that has refused its bundle: its incarnation then
        in_bundles = frozenset[str]().union(*(one.images for one in self._bundles))
        self._needs: dict[str, frozenset[str]] = {  # by PE: its images that come in bundles
            pe.name: in_bundles.intersection(
                one.image
                for one in settings.spec.modules.values()
                if pe.name in hosts_when_all_is_up(settings.spec, one)
            )
            for pe in here
        }
        self.clear: Callable[[str], None] = lambda _: None
        """Clears the fault of an element, as an operator does; the manager sets it."""

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return identifier in self._pe_of_answer or identifier in self._pe_of_request

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: there is nothing to bring."""
        if self._transfer is not None:
            return self._transfer.next_ns
        if self._due is not None:
            return self._due[0]
        return self._look_ns if self._now is None else self._reader.next_ns

    def status(self) -> dict[str, str]:
        """Return by PE what is on its way to it, or why it is not."""
        said = dict(self._told)
        if self._now is not None:
            pe, bundle = self._now
            said[pe] = f"{bundle.name}, version {bundle.version}: {self._at} of {len(bundle.content)} bytes"
        return said

    def take(self, frame: Frame) -> None:
        """Process an SDO answer of a PE, or the request of another SDO client to it."""
        if frame.can_id in self._pe_of_request:
            self._leave(self._pe_of_request[frame.can_id], FOR_ANOTHER_NS)
        elif self._now is not None and self._pe_of_answer.get(frame.can_id) == self._now[0]:
            if self._transfer is None:
                self._reader.heard(self._node[self._now[0]], frame.data, self._turn.now_ns)
            else:
                self._transfer.heard(frame.data, self._turn.now_ns)
                self._look_at(self._transfer)

    def tick(self) -> None:
        """Do what is due, and look for code that a PE lacks."""
        now_ns = self._turn.now_ns
        if self._now is None:
            if now_ns >= self._look_ns:
                self._look_ns = now_ns + LOOK_NS
                self._begin_next()
        elif not self._health.is_available(self._now[0]):
            if self._transfer is not None:
                self._transfer.stop()
            self._leave(self._now[0], SHORTEST_PAUSE_NS)
        elif self._transfer is not None:
            self._send_segment(*self._now, self._transfer)
        elif self._due is not None:
            if now_ns >= self._due[0]:
                (_, act), self._due = self._due, None
                act()
        else:
            self._reader.tick(now_ns)

    def end_of_step(self) -> None:
        """Forget everything if this manager is not active any more; to be called after each event."""
        if not self._claim.is_active and (self._now is not None or self._told):
            self._end()
            self._told.clear()
            self._refused.clear()
            self._tries.clear()
            self._not_before_ns.clear()

    # What is lacking

    def _lacking(self) -> list[LatchedFault]:
        """Return the faults that are lacks of code, the most critical module first."""
        found = [one for one in self._situation.lacking_code() if one.by in self._node]
        return sorted(found, key=lambda one: (self._ranks[_module(one)], one.element))

    def _begin_next(self) -> None:
        now_ns = self._turn.now_ns
        if not self._claim.is_active or self._turn.silent or self._pace.is_held():
            return
        lacking = self._lacking()
        for pe in self._told.keys() - {one.by for one in lacking}:
            del self._told[pe]
            self._refused.pop(pe, None)
        for fault in lacking:
            pe = fault.by
            ready_ns = max(self._not_before_ns.get(pe, 0), fault.since_ns + _AFTER_JOINING_NS)
            image = self._spec.modules[_module(fault)].image
            if image in self._needs[pe] and ready_ns <= now_ns and self._may_try(pe):
                bundle = self._bundle_for(self._needs[pe])
                if bundle is None:
                    self._fail(
                        pe, f"no bundle holds all of its code: build one with {', '.join(sorted(self._needs[pe]))}"
                    )
                    continue
                if len(bundle.content) > self._spec.pes[pe].flash:
                    self._fail(
                        pe, f"{bundle.name} has {len(bundle.content)} bytes, more than its flash: leave files out"
                    )
                    continue
                if self._served.begin(self._node[pe], now_ns):
                    self._now, self._began_ns, self._at = (pe, bundle), now_ns, 0
                    self._read_raw(PROGRAM_TRANSFER, 3, self._active)
                    return

    def _may_try(self, pe: str) -> bool:
        is_the_same = pe in self._refused and self._refused[pe] == self._health.incarnation(pe)
        return self._health.is_available(pe) and not is_the_same

    def _bundle_for(self, images: frozenset[str]) -> CodeBundle | None:
        holding = [one for one in self._bundles if images <= one.images]
        return max(holding, key=lambda one: (len(one.images), one.version), default=None)

    # The steps of a transfer

    def _active(self, digest: bytes) -> None:
        assert self._now is not None
        if digest == sha256(self._now[1].content).digest():
            self._arrived()
        else:
            self._read(PROGRAM_VERSION, 1, self._version)

    def _version(self, value: int) -> None:
        assert self._now is not None
        pe, bundle = self._now
        if value >= bundle.version:
            self._fail(pe, f"it has version {value} of its code: build {bundle.name} with a higher one")
        else:
            self._read_raw(PROGRAM_TRANSFER, 2, self._received)

    def _received(self, value: bytes) -> None:
        assert self._now is not None
        known, content = Received.decode(value), self._now[1].content
        is_this = known is not None and known.digest == sha256(content).digest()
        self._at = known.length if known is not None and is_this else 0
        self._send_part()

    def _send_part(self) -> None:
        assert self._now is not None
        content, at = self._now[1].content, self._at
        if at >= len(content):
            self._looks = 0
            self._look_later(self._checked)
            return
        part = Part(Transfer(sha256(content).digest(), len(content)), at, content[at : at + PART_BYTES])

        def sent() -> None:
            self._at = at + len(part.data)
            self._send_part()

        self._write(PROGRAM_TRANSFER, part.encode(), sent)

    def _checked(self, status: int) -> None:
        if self._is_done(status, self._checked):
            self._looks = 0
            self._write(PROGRAM_CONTROL, _START, lambda: self._look_later(self._started))

    def _started(self, status: int) -> None:
        if self._is_done(status, self._started):
            self._read_raw(PROGRAM_TRANSFER, 3, self._runs)

    def _runs(self, digest: bytes) -> None:
        assert self._now is not None
        if digest == sha256(self._now[1].content).digest():
            self._arrived()
        else:
            self._fail(self._now[0], "it has taken the code, and does not use it: its log says why")

    def _arrived(self) -> None:
        assert self._now is not None
        (pe, bundle), took_ns = self._now, self._turn.now_ns - self._began_ns
        self._end()
        self._told.pop(pe, None)
        self._tries.pop(pe, None)
        self._not_before_ns[pe] = self._turn.now_ns + SHORTEST_PAUSE_NS
        name, version, size = bundle.name, bundle.version, len(bundle.content)
        self._turn.emit(events.CodeBrought, pe=pe, bundle=name, version=version, bytes=size, took_ns=took_ns)
        for fault in self._lacking():
            if fault.by == pe and self._spec.modules[_module(fault)].image in bundle.images:
                self.clear(fault.element)

    # SDO

    def _look_later(self, then: Callable[[int], None]) -> None:
        self._due = self._turn.now_ns + LOOK_NS, lambda: self._read(PROGRAM_STATUS, 1, then)

    def _is_done(self, status: int, again: Callable[[int], None]) -> bool:
        """Tell whether the loader has done its work well; else look again, or fail."""
        assert self._now is not None
        self._looks += 1
        if status & 1 and self._looks < _MOST_LOOKS:
            self._look_later(again)
        elif status:
            if status >> 1 in _FOR_GOOD:
                self._refused[self._now[0]] = self._health.incarnation(self._now[0])
            why = "its loader does not end its work" if status & 1 else f"it gives the error {status >> 1} of 1F57h"
            self._fail(self._now[0], _ERRORS.get(status >> 1, why))
        return not status

    def _read(self, index: int, sub_index: int, take: Callable[[int], None]) -> None:
        assert self._now is not None
        pe = self._now[0]

        def took(value: bytes) -> None:
            number = read_number(value)
            if number is None:
                self._fail(pe, _SILENT)
            else:
                take(number)

        self._read_raw(index, sub_index, took)

    def _read_raw(self, index: int, sub_index: int, take: Callable[[bytes], None]) -> None:
        assert self._now is not None
        pe = self._now[0]

        def took(value: bytes | None) -> None:
            if self._now is None:
                return  # the transfer was ended, and its reader with it
            if value is None:
                self._fail(pe, _SILENT)
            else:
                take(value)

        self._reader.read(self._node[pe], index, sub_index, took, self._turn.now_ns)

    def _write(self, index: int, content: bytes, then: Callable[[], None]) -> None:
        """Write sub-index 1 of an object, after an UNLOCK if there is a key; then `then` follows."""
        assert self._now is not None
        pe = self._now[0]
        if self._key is None:
            self._open(pe, index, content, then)
            return
        self._turn.send(Command.CONTROL, Control(self._turn.term, self._node[pe], Operation.UNLOCK, _UNLOCK_S))
        self._due = self._turn.now_ns + _AFTER_UNLOCK_NS, lambda: self._open(pe, index, content, then)

    def _open(self, pe: str, index: int, content: bytes, then: Callable[[], None]) -> None:
        period_ns = self._pace.period_ns(pe)
        if period_ns is None:
            self._fail(pe, _NO_ROOM)
            return
        node = self._node[pe]
        self._transfer = BlockDownload(
            index,
            content,
            period_ns,
            lambda said: self._turn.do(Send(0, Frame(sdo_request_id(node), said))),
            sub_index=1,
        )
        self._then = then
        self._transfer.begin(self._turn.now_ns)

    def _send_segment(self, pe: str, _: CodeBundle, transfer: BlockDownload) -> None:
        """Send the segment that is due, at the pace that what runs now allows."""
        now_ns, period_ns = self._turn.now_ns, self._pace.period_ns(pe)
        if period_ns is None:
            transfer.stop()
            self._fail(pe, _NO_ROOM)
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
        assert self._now is not None
        assert then is not None
        if transfer.outcome is Outcome.TAKEN:
            then()
        else:
            self._fail(self._now[0], transfer.why)

    # The end of a transfer

    def _fail(self, pe: str, why: str) -> None:
        if self._told.get(pe) != why:
            self._told[pe] = why
            self._turn.emit(events.CodeNotTaken, pe=pe, why=why)
        self._pause_after(pe)
        self._end()

    def _pause_after(self, pe: str) -> None:
        """Pause the transfers to a PE for twice as long as the last time."""
        before = self._tries.get(pe, 0)
        self._tries[pe] = before + 1
        self._not_before_ns[pe] = self._turn.now_ns + min(SHORTEST_PAUSE_NS << min(before, 16), LONGEST_PAUSE_NS)

    def _leave(self, pe: str, pause_ns: int) -> None:
        """End the transfer to a PE if there is one; none to it begins for `pause_ns`."""
        self._not_before_ns[pe] = max(self._not_before_ns.get(pe, 0), self._turn.now_ns + pause_ns)
        if self._now is not None and self._now[0] == pe:
            self._end()

    def _end(self) -> None:
        if self._now is not None:
            self._served.end(self._turn.now_ns)
        self._now, self._transfer, self._then, self._due = None, None, None, None
        self._reader.give_up()


def _module(fault: LatchedFault) -> str:
    """Return the module of a fault, without its place."""
    return fault.element.removeprefix("module:").partition("@")[0]
