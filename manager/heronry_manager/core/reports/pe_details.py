"""Details that PEs store for people: why modules failed, how often a computer stood still, and which table it has.

The manager reads these details by SDO.

*Failure of a module.* When an EMCY has reported the failure, the manager reads the reason, and emits it as an
event. It keeps the last failure of each module. A PE that is busy may not answer. So the manager asks up to
three times, two seconds apart. If it gets no answer, no event comes until the PE's next EMCY about the module.
A failure that the PE mended by a restart is over after FORGIVEN_AFTER_NS; the PE, too, forgets it then. Any other
failure latches a fault, and is over when that is cleared.

*Traceback.* The manager reads it when the operator asks for it, from the PE that reported the last failure.

*Standstills of a PE.* The manager reads them when the PE joins, answers a PING, or is heard again, and when the
operator asks for the status. A standstill is *long* if it exceeds a heartbeat period.

- When a PE has answered a PING, or is heard again, the reading causes an event if the PE has had long standstills
  since the last reading that was not for the status: they may be the reason why the PE was not heard. The event
  gives the longest standstill of the PE if that one is new, otherwise the last long one.
- If such a reading fails, the next successful reading causes the event, unless it is for the status.
- A manager reads nothing when it becomes active, since a foreign SDO client may be reading just then. So its
  first report on a PE counts from the start of that PE.

*Cost of a PE.* The manager reads what a PE costs its computer (object 2023h) when the operator asks for the status, at
most once in WINDOW_NS, the time after which the PE has new figures. The next status shows it.

*Table of a PE.* If a PE refuses a slice for its digest, the manager reads the version of the protocol and the digest of
the spec from the PE, and tells in an event why the PE stages nothing. It tells this again only if the reason is another
one. Without an answer it tells what it knows. Anybody may forge the answer, which therefore changes nothing but the
sentence.

A manager reads these details only while it is active and may send, and only from PEs on its own bus: to those beyond
gateways, SDO is for tables and code. From a PE that is being brought one of these it reads later. It keeps what it has
read until it ends; another manager reads the details again. `object_reader` says what lost, late, doubled and forged
frames cause. No decision depends on these details.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from functools import cache, partial
from typing import Any

from heronry_dg.situation import hosts_when_all_is_up, module_of
from heronry_manager import events
from heronry_manager.core.epochs import ANOTHER_TABLE
from heronry_manager.core.mastership import Claim
from heronry_manager.core.sdo_client import ObjectReader
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_wire.canopen_objects import COST, COUNTERS, MODULE_FAILURES, MODULE_TRACEBACKS, SPEC
from heronry_wire.failure_text import plain_reason, plain_traceback
from heronry_wire.management import Emergency, FaultCode
from heronry_wire.node_cost import WINDOW_NS, NodeCost
from heronry_wire.protocol_times import FORGIVEN_AFTER_NS, t_lease_ns
from heronry_wire.protocol_version import PROTOCOL, Version
from heronry_wire.sdo import read_number
from heronry_wire.standstill import Standstills, StoodStill

_COUNTERS = ((3, "times"), (4, "long_times"), (5, "last_long_ms"), (6, "longest_ms"))  # sub-indices, and what they are
_COST = tuple(enumerate((one.name for one in fields(NodeCost)), start=1))
_NOT_MEASURED = 0xFFFF_FFFF
_OF_TABLE = (3, 4)  # sub-indices: digest of the spec, version of the protocol
_NS_PER_MS = 1_000_000
_TRIES = 3  # to read why a module has failed


class Look(Enum):
    """Why the standstills of a PE are read."""

    BEGIN = "the PE joins: earlier standstills are not reported"
    TELL = "the PE was not heard: new standstills are reported"
    SHOW = "the operator requests the status"


@dataclass(frozen=True, slots=True)
class _Failure:
    """The last failure of a module.

    by: the PE that gave the reason. at_ns: when the manager had read it. runs_again: the PE has restarted the module.
    """

    element: str
    by: str
    text: str
    at_ns: int
    runs_again: bool


class PeDetails:
    """Reads the details that PEs store for people, and keeps them.

    It also counts the standstills of this manager's computer.
    """

    def __init__(self, settings: ManagerSettings, turn: Turn, claim: Claim, reader: ObjectReader) -> None:
        self._spec, self._turn, self._claim = settings.spec, turn, claim
        self._is_wanted = settings.reads_objects
        self._reader = reader
        self.own = Standstills(settings.bus.heartbeat_ns)
        self._node = f"manager {settings.node}"
        self._again_after_ns = t_lease_ns(settings.bus.heartbeat_ns)
        self._heard: dict[tuple[str, str], tuple[object, int]] = {}  # last EMCY by PE and module, and when it came
        self._failures: dict[str, _Failure] = {}  # by element
        self._standstills: dict[str, dict[str, int]] = {}  # by PE
        self._costs: dict[str, dict[str, int]] = {}  # by PE
        self._cost_read_ns: dict[str, int] = {}  # by PE
        self._compared: dict[str, dict[str, int]] = {}  # by PE: with which the next ones are compared
        self._untold: set[str] = set()  # PEs of which a reading to report new standstills has not succeeded yet
        self._tables: dict[str, str] = {}  # why a PE stages nothing, as it was told last
        self._position = cache(self._position_in_table)

    def stood_still(self, event: StoodStill) -> None:
        """Count a standstill of this manager's computer, and report it as an event if it is long.

        For TELL_AGAIN_NS after such an event, only a standstill longer than the reported one is reported.
        """
        if self.own.count(event, self._turn.now_ns):
            self._turn.emit(events.StoodStill, by=self._node, for_ns=event.for_ns, times=self.own.long_times)

    def failed(self, pe: str, element: str, emergency: Emergency) -> None:
        """Read from a PE why a module has failed, and report the reason in an event.

        The PE repeats its EMCY; a repetition of the same EMCY has no effect.
        """
        heard_ns = self._turn.now_ns
        before, at_ns = self._heard.get((pe, element), (None, 0))
        self._heard[pe, element] = emergency, heard_ns
        if before == emergency and heard_ns - at_ns <= self._again_after_ns:
            return

        def take(value: bytes | None) -> None:
            text = "" if value is None else plain_reason(value.decode("ascii", "replace"))
            if text:
                runs_again = emergency.code is FaultCode.MODULE_RESTARTED
                self._failures[element] = _Failure(element, pe, text, self._turn.now_ns, runs_again)
                self._turn.emit(events.ModuleFailed, element=element, by=pe, text=text, heard_ns=heard_ns)

        self._read(pe, MODULE_FAILURES, self._position(pe, element), take, tries=_TRIES)

    def traceback(self, element: str, answer: Callable[[str | None, str], None]) -> None:
        """Read the traceback of a module's last failure; `answer` gets it, or None and a sentence that says why not."""
        known = self._failures.get(element)
        if known is None:
            others = ", ".join(self._failures)
            known_ones = f"the known failures are those of {others}" if others else "no module has failed"
            answer(None, f"no failure of {element} is known to this manager: {known_ones}")
            return
        pe = known.by

        def take(value: bytes | None) -> None:
            if value:
                answer(plain_traceback(value.decode("ascii", "replace")), "")
            elif value is None:
                answer(None, f"{pe} does not give the traceback of {element}: look into the log of its agent")
            else:
                answer(None, f"{pe} has no traceback of {element}: no exception was raised ({known.text})")

        self._read(pe, MODULE_TRACEBACKS, self._position(pe, element), take)

    def look_at_standstills(self, pe: str, look: Look) -> None:
        """Read how often the computer of a PE has stood still, and for how long.

        look: why this is read; the reason decides whether new standstills are reported in an event.
        """
        if look is Look.TELL:
            self._untold.add(pe)
        self._read_numbers(pe, COUNTERS, _COUNTERS, lambda found: self._found_standstills(pe, found, look))

    def look_at_cost(self, pe: str) -> None:
        """Read what a PE costs its computer, unless this was done in the last WINDOW_NS."""
        now_ns = self._turn.now_ns
        if now_ns - self._cost_read_ns.get(pe, -WINDOW_NS) < WINDOW_NS:
            return
        self._cost_read_ns[pe] = now_ns

        def take(found: dict[str, int]) -> None:
            if _NOT_MEASURED in found.values():
                del self._cost_read_ns[pe]
            else:
                self._costs[pe] = found

        self._read_numbers(pe, COST, _COST, take)

    def look_at_table(self, pe: str, *, flies: bool) -> None:
        """Read from a PE that refuses a slice for its digest which table it has, and tell why it stages nothing.

        flies: the PE runs what this manager does not know.
        """
        found: dict[int, bytes | None] = {}

        def take(sub_index: int, value: bytes | None) -> None:
            found[sub_index] = value
            if len(found) == len(_OF_TABLE):
                why = self._why_another_table(*(found[one] for one in _OF_TABLE))
                self._tell_table(pe, f"{why}; until then it goes on with what it runs" if flies else why)

        for sub_index in _OF_TABLE:
            self._read(pe, SPEC, sub_index, partial(take, sub_index))

    def table_is_right(self, pe: str) -> None:
        """Forget that a PE had another table, since it has restarted, or is not heard any more."""
        self._tables.pop(pe, None)

    def other_tables(self) -> dict[str, str]:
        """Return the PEs that have another table, each with the sentence that says why and what to do."""
        return dict(self._tables)

    def _why_another_table(self, digest: bytes | None, version: bytes | None) -> str:
        anew = "write it anew with 'heronry table', and restart the PE"
        number = None if version is None else read_number(version)
        if digest is None or number is None:
            return f"{ANOTHER_TABLE}: {anew}"
        spoken, of_spec = Version.of_number(number), digest.decode("ascii", "replace")
        if spoken.major != PROTOCOL.major:
            return (
                f"it speaks protocol {spoken}, and this manager {PROTOCOL}: install the same major version of heronry "
                "for both, and write its table anew with 'heronry table'"
            )
        if of_spec != self._spec.digest:
            return f"its table is of another spec ({of_spec:.12}): {anew}"
        return f"its table was compiled otherwise, or damaged in memory: {anew}"

    def _tell_table(self, pe: str, why: str) -> None:
        if self._tables.get(pe) != why:
            self._tables[pe] = why
            self._turn.emit(events.AnotherTable, pe=pe, why=why)

    @property
    def next_ns(self) -> int:
        """Time (ns) at which to call `tick`; NEVER_NS: nothing is being read."""
        return self._reader.next_ns

    def tick(self) -> None:
        """Go on reading, if it is time."""
        self._reader.tick(self._turn.now_ns)

    def heard(self, node: int, message: bytes) -> None:
        """Take an SDO answer of the PE with this node-ID."""
        self._reader.heard(node, message, self._turn.now_ns)

    def heard_other(self, node: int) -> None:
        """Note that another SDO client has made a request to the PE with this node-ID."""
        self._reader.heard_other(node, self._turn.now_ns)

    def end_of_step(self) -> None:
        """Stop reading if this manager is not active any more; to be called after each event."""
        if not self._claim.is_active:
            self._reader.give_up()

    def failures(self, latched: Collection[str]) -> list[dict[str, Any]]:
        """Return the last failure of each module, oldest first, as a dict with five keys.

        element: the module that has failed.
        by: the PE that reported the failure.
        text: the reason, as read from this PE.
        for_ns: time since the reason was read.
        is_over: the module is mended, as far as this manager knows (head of this file).

        latched: elements and places on which a fault is latched.
        """
        failed, found = {module_of(one) for one in latched}, list[dict[str, Any]]()
        for one in sorted(self._failures.values(), key=lambda one: one.at_ns):
            for_ns = self._turn.now_ns - one.at_ns
            is_over = one.element not in failed and (for_ns > FORGIVEN_AFTER_NS or not one.runs_again)
            told = {"element": one.element, "by": one.by, "text": one.text}
            found.append({**told, "for_ns": for_ns, "is_over": is_over})
        return found

    def standstills(self, pe: str) -> Mapping[str, int] | None:
        """Return how often the computer of a PE has stood still; None: this was not read yet.

        The keys are times, long_times, last_long_ms and longest_ms.
        """
        return self._standstills.get(pe)

    def cost(self, pe: str) -> Mapping[str, int] | None:
        """Return what a PE costs its computer, by the names of `NodeCost`; None: this was not read yet."""
        return self._costs.get(pe)

    def own_standstills(self) -> dict[str, int]:
        """Return how often and for how long this manager's own computer has stood still.

        The keys are those that `standstills` gives for a PE.
        """
        own = self.own
        times_ms = {"last_long_ms": own.last_long_ns // _NS_PER_MS, "longest_ms": own.longest_ns // _NS_PER_MS}
        return {"times": own.times, "long_times": own.long_times, **times_ms}

    def _found_standstills(self, pe: str, found: dict[str, int], look: Look) -> None:
        times, before = found["long_times"], self._compared.get(pe, {"long_times": 0, "longest_ms": 0})
        self._standstills[pe] = found
        if look is Look.SHOW:  # a status that is asked for just then must not hide what has to be told
            return
        is_to_be_told = pe in self._untold
        self._compared[pe] = found
        self._untold.discard(pe)
        has_restarted = times < before["long_times"]  # and counts anew
        if not is_to_be_told or times == (0 if has_restarted else before["long_times"]):
            return
        is_longest_new = has_restarted or found["longest_ms"] > before["longest_ms"]
        for_ms = found["longest_ms"] if is_longest_new else found["last_long_ms"]
        self._turn.emit(events.StoodStill, by=pe, for_ns=for_ms * _NS_PER_MS, times=times)

    def _read_numbers(
        self, pe: str, index: int, keys: Sequence[tuple[int, str]], done: Callable[[dict[str, int]], None]
    ) -> None:
        """Read several elements of an object of a PE; `done` gets their values, if all have come."""
        found: dict[str, int] = {}

        def take(key: str, value: bytes | None) -> None:
            number = None if value is None else read_number(value)
            if number is not None:
                found[key] = number
            if key == keys[-1][1] and len(found) == len(keys):
                done(found)

        for sub_index, key in keys:
            self._read(pe, index, sub_index, partial(take, key))

    def _read(
        self, pe: str, index: int, sub_index: int, take: Callable[[bytes | None], None], *, tries: int = 1
    ) -> None:
        is_possible = self._is_wanted and self._claim.is_active and not self._turn.silent
        if is_possible and self._spec.manager.bus in self._spec.pes[pe].buses and sub_index:
            self._reader.read(self._spec.pes[pe].node_id, index, sub_index, take, self._turn.now_ns, tries=tries)
        else:
            take(None)

    def _position_in_table(self, pe: str, element: str) -> int:
        """Return the position of a module among those in a PE's table, from 1; 0: it is not in that table."""
        name = element.partition(":")[2]
        modules = [one.name for one in self._spec.modules.values() if pe in hosts_when_all_is_up(self._spec, one)]
        return modules.index(name) + 1 if name in modules else 0
