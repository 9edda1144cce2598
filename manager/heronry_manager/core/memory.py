"""What a manager must not forget when it restarts: numbers and facts.

The core gives out each change of this memory as a record (`Keep`). All records in order make the memory
(`Memory.after`). The journal keeps the records on disk; `shell.journal` says which records a restart may lose.

    numbers   the last term, the last *reserved* epoch, and the last reserved number of each counter. None of these
              numbers may be used twice. Numbers are reserved in blocks, so that the disk is written once per block. A
              reservation is on disk before the first frame that uses it. So the numbers only rise, whatever else is
              lost
    facts     what runs: epoch, digest, and the configuration as a row of `configuration_code`
              the mark of the spec that flies, if a change of the spec in flight was heard of or made
              the mission phase
              the changed priorities, and the last request of each PE for a priority
              the latched faults, also those that the operator declared
              the quarantined PEs

The frames that follow from a fact may be sent before the fact is on disk, so a restart may find an outdated fact. The
only harm is one more epoch, since the PEs report what runs.

A restart forgets how long ago a fault was latched, and the losses of available PEs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from heronry_wire.management import MAX_TERM, NO_EPOCH

EPOCHS = "epoch"  # kind of number
MOST_MARK = 0xFFFF  # of a spec


@dataclass(frozen=True, slots=True)
class TermBegun:
    """A mastership has begun, under this term."""

    term: int


@dataclass(frozen=True, slots=True)
class Reserved:
    """The manager may use numbers of `kind` up to `last`; after a restart it uses none of them again."""

    kind: str
    last: int


@dataclass(frozen=True, slots=True)
class Runs:
    """An epoch was activated, or adopted; `row`: its configuration, encoded by `configuration_code`, in hexadecimal."""

    epoch: int
    digest: int
    row: str


@dataclass(frozen=True, slots=True)
class SpecFlies:
    """The aircraft has changed to another spec in flight, or is said to have; `mark` of that spec (`spec_mark`)."""

    mark: int


@dataclass(frozen=True, slots=True)
class PhaseEntered:
    """The mission has entered this phase."""

    phase: str


@dataclass(frozen=True, slots=True)
class PhaseRequest:
    """A PE's request for a phase was executed; `number` counts the requests of the PE in this incarnation."""

    pe: str
    incarnation: int
    number: int


@dataclass(frozen=True, slots=True)
class PriorityChanged:
    """A function has another priority than the spec gives it."""

    function: str
    priority: int
    by_operator: bool


@dataclass(frozen=True, slots=True)
class PriorityRestored:
    """A function has the priority of the spec again."""

    function: str


@dataclass(frozen=True, slots=True)
class PriorityRequest:
    """A PE's request for a priority was executed; `number` counts the requests of the PE in this incarnation."""

    pe: str
    incarnation: int
    function: str
    number: int


@dataclass(frozen=True, slots=True)
class Latched:
    """An element counts as failed until it is cleared."""

    element: str
    by: str  # the PE or operator that has reported the fault
    code: str  # name of the fault code
    detail: int  # further number of the report; its meaning depends on the code


@dataclass(frozen=True, slots=True)
class Cleared:
    """An element no longer counts as failed."""

    element: str


@dataclass(frozen=True, slots=True)
class Quarantined:
    """A PE was lost again, and is held down for longer than after a single loss; `losses`: how often it was lost."""

    pe: str
    losses: int


@dataclass(frozen=True, slots=True)
class Released:
    """A PE has left its quarantine."""

    pe: str


PriorityRecord = PriorityChanged | PriorityRestored | PriorityRequest
Record = (
    TermBegun
    | Reserved
    | Runs
    | SpecFlies
    | PhaseEntered
    | PhaseRequest
    | PriorityRecord
    | Latched
    | Cleared
    | Quarantined
    | Released
)
_NUMBERS = (TermBegun, Reserved)


def is_number(record: Record) -> bool:
    """Tell whether a record must be on disk before the driver sends any frame that follows it."""
    return isinstance(record, _NUMBERS)


@dataclass(frozen=True, slots=True)
class Memory:
    """All that a manager remembers over a restart."""

    term: int = 0
    reserved: Mapping[str, int] = field(default_factory=dict)
    runs: Runs | None = None
    phase: str | None = None  # None: none was entered
    latched: Mapping[str, Latched] = field(default_factory=dict)  # by element, the oldest first
    quarantined: Mapping[str, int] = field(default_factory=dict)  # losses, by PE
    phase_requests: Mapping[str, PhaseRequest] = field(default_factory=dict)  # by PE, its last request
    priorities: Mapping[str, PriorityChanged] = field(default_factory=dict)  # by function
    priority_requests: Mapping[tuple[str, str], PriorityRequest] = field(default_factory=dict)  # by PE and function
    flies: int | None = None  # mark of the spec that flies; None: no change of the spec is known

    def after(self, record: Record) -> "Memory":
        """Return a new memory: this one with the change that the record describes."""
        match record:
            case TermBegun() | Reserved():
                return self._with_number(record)
            case Runs() | SpecFlies():
                return replace(self, runs=record) if isinstance(record, Runs) else replace(self, flies=record.mark)
            case PhaseEntered(phase):
                return replace(self, phase=phase)
            case PhaseRequest(pe):
                return replace(self, phase_requests={**self.phase_requests, pe: record})
            case PriorityChanged() | PriorityRestored() | PriorityRequest():
                return self._with_priority(record)
            case Latched(element):
                return replace(self, latched={**self.latched, element: record})
            case Cleared(element):
                return replace(self, latched={e: one for e, one in self.latched.items() if e != element})
            case Quarantined(pe, losses):
                return replace(self, quarantined={**self.quarantined, pe: losses})
            case Released(pe):  # pragma: no branch - nothing else is left
                return replace(self, quarantined={p: n for p, n in self.quarantined.items() if p != pe})

    def _with_number(self, record: TermBegun | Reserved) -> "Memory":
        if isinstance(record, TermBegun):
            return replace(self, term=record.term)
        return replace(self, reserved={**self.reserved, record.kind: record.last})

    def _with_priority(self, record: PriorityRecord) -> "Memory":
        match record:
            case PriorityChanged(function):
                return replace(self, priorities={**self.priorities, function: record})
            case PriorityRestored(function):
                return replace(self, priorities={f: one for f, one in self.priorities.items() if f != function})
            case PriorityRequest(pe, _, function):  # pragma: no branch - nothing else is left
                return replace(self, priority_requests={**self.priority_requests, (pe, function): record})

    def records(self) -> list[Record]:
        """Return the fewest records that make this memory out of an empty one."""
        records: list[Record] = [TermBegun(self.term)] if self.term else []
        records += [Reserved(kind, last) for kind, last in self.reserved.items()]
        records += [self.runs] if self.runs is not None else []
        records += [SpecFlies(self.flies)] if self.flies is not None else []
        records += [PhaseEntered(self.phase)] if self.phase is not None else []
        records += self.phase_requests.values()
        records += self.priorities.values()
        records += self.priority_requests.values()
        records += self.latched.values()
        return records + [Quarantined(pe, losses) for pe, losses in self.quarantined.items()]

    def numbers(self) -> "Memory":
        """Return what is still valid if the spec has changed: the numbers that must not be used again."""
        return Memory(self.term, self.reserved)


NOTHING = Memory()


def as_json(record: Record) -> list[str | int]:
    """Encode a record as a list: its kind, then its fields."""
    match record:
        case TermBegun() | Reserved():
            return ["term", record.term] if isinstance(record, TermBegun) else ["reserved", record.kind, record.last]
        case Runs() | SpecFlies():
            return _what_flies_as_json(record)
        case PhaseEntered(phase):
            return ["phase", phase]
        case PhaseRequest(pe, incarnation, number):
            return ["asked", pe, incarnation, number]
        case PriorityChanged() | PriorityRestored() | PriorityRequest():
            return _priority_as_json(record)
        case Latched(element, by, code, detail):
            return ["latched", element, by, code, detail]
        case Cleared(element):
            return ["cleared", element]
        case Quarantined(pe, losses):
            return ["quarantined", pe, losses]
        case Released(pe):  # pragma: no branch - nothing else is left
            return ["released", pe]


def _what_flies_as_json(record: Runs | SpecFlies) -> list[str | int]:
    if isinstance(record, SpecFlies):
        return ["flies", record.mark]
    return ["runs", record.epoch, record.digest, record.row]


def _priority_as_json(record: PriorityRecord) -> list[str | int]:
    match record:
        case PriorityChanged(function, priority, by_operator):
            return ["priority", function, priority, "ordered" if by_operator else "requested"]
        case PriorityRestored(function):
            return ["restored", function]
        case PriorityRequest(pe, incarnation, function, number):  # pragma: no branch - nothing else is left
            return ["wanted", pe, incarnation, function, number]


def from_json(content: object) -> Record | None:
    """Decode a record from a list; None: the content is not a record."""
    match content:
        case ["term", int(term)] if 0 < term <= MAX_TERM:
            return TermBegun(term)
        case ["reserved", str(kind), int(last)]:
            return Reserved(kind, last)
        case _:
            return _fact(content)


def _fact(content: object) -> Record | None:
    match content:
        case ["runs", int(epoch), int(digest), str(row)] if epoch != NO_EPOCH:
            return Runs(epoch, digest, row)
        case ["flies", int(mark)] if 0 <= mark <= MOST_MARK:
            return SpecFlies(mark)
        case ["phase", str(phase)]:
            return PhaseEntered(phase)
        case ["asked", str(pe), int(incarnation), int(number)]:
            return PhaseRequest(pe, incarnation, number)
        case ["latched", str(element), str(by), str(code), int(detail)]:
            return Latched(element, by, code, detail)
        case ["cleared", str(element)]:
            return Cleared(element)
        case ["quarantined", str(pe), int(losses)]:
            return Quarantined(pe, losses)
        case ["released", str(pe)]:
            return Released(pe)
        case _:
            return _priority_fact(content)


def _priority_fact(content: object) -> Record | None:
    match content:
        case ["priority", str(function), int(priority), "ordered" | "requested" as how]:
            return PriorityChanged(function, priority, by_operator=how == "ordered")
        case ["restored", str(function)]:
            return PriorityRestored(function)
        case ["wanted", str(pe), int(incarnation), str(function), int(number)]:
            return PriorityRequest(pe, incarnation, function, number)
        case _:
            return None
