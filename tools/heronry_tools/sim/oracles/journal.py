"""The journal on a manager's disk agrees with what the manager sends, whenever the manager sends something new.

A manager that restarts knows only the bytes on its disk. The oracle reads the bytes as a restarted manager would
(`recovered`), and compares them with the manager's frames in the present mastership:

    term         a frame names a higher term: the journal has this term or a higher one. Otherwise the term might be
                 used a second time after a restart
    epochs       a PREPARE has a number that no other manager has prepared before, and that this manager has not
                 adopted: the number lies within the reserved block
    what runs    a LEASE names another epoch than before, and its step is BREAK or a later one: the journal has this
                 epoch with this digest
    phase        HOLDS names a phase: the journal has this phase
    faults       HOLDS names an element: the journal has the element as latched. CLEAR names it: not as latched
    priorities   HOLDS names a priority: the journal has this priority of the function. CLEAR names it: the journal has
                 no priority of the function

A manager forces its terms and epoch numbers onto the disk before it uses them. So when a manager has died
(`manager_died`), these numbers are compared again with what a power cut has left on the disk. Phase, faults and
priorities need not survive a power cut.

A manager may be started on a copy of another manager's disk (`manager_copied`). Then the copy must also agree with what
the other manager has sent until this start. What the station of the new manager sent before the start no longer
matters.

A frame may have waited in the controller, so it may be older than the last write to the journal. For this reason the
journal may have a newer epoch than the frame. Of a phase, a fault or a priority, the journal need not agree with the
frame now. It is enough if it agreed when the oracle read it last, or before the last few records were written.

Not verified:

- a disk that accepts no write (the caller gives no bytes)
- a standby manager that has sent nothing yet
- the frames of a deposed manager (the caller does not report them)
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from heronry_dg.model import Spec
from heronry_manager.core.memory import EPOCHS, Memory
from heronry_manager.shell.journal import recovered
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.places import Places
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import (
    BY_OPERATOR,
    NO_EPOCH,
    Control,
    ElementKind,
    Lease,
    ManagementMessage,
    Operation,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    is_newer,
)

_WAITED = 8 * 3  # lines that may be written while a frame waits: each record takes two copies and an empty line
_FIRST_PHASE_NS = 1_000_000_000  # for which a frame that names the first phase may wait
Read = Callable[[str], bytes | None]  # bytes on the disk of a station's manager; None where they must not be verified


@dataclass(slots=True)
class _Said:
    """What one manager has sent in all its masterships, as far as its journal must have it.

    term: the highest term.
    prepared: epoch of the last PREPARE whose epoch no other manager had prepared before.
    leased: epoch and digest of the last LEASE with a step after PREPARED.
    """

    term: int = 0
    prepared: int = NO_EPOCH
    leased: tuple[int, int] = (NO_EPOCH, 0)


class JournalCheck(Oracle):
    """Verifies that the frames of each manager agree with the journal on its disk."""

    def __init__(self, spec: Spec, read: Read, switched_by: int | None = None) -> None:
        """Begin with no manager; switched_by: the epoch by which the PEs change to this spec, if they do.

        The journal gets this epoch only when all PEs have changed.
        """
        super().__init__()
        self._switched_by = switched_by
        self._read = read
        self._places = Places(spec)
        self._phases, self._functions = list(spec.phases), list(spec.functions)
        self._said: dict[str, _Said] = {}  # by station
        self._prepared: dict[int, str] = {}  # by epoch: the station that prepared it first ("" after `manager_copied`)
        self._none_entered_ns: dict[str, int] = {}  # by station: the last time when its journal named no phase
        self._last_read: dict[str, tuple[bytes, Memory]] = {}  # by station: bytes on its disk, and what they hold

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """Verify a command of a manager; `station` is the name of the manager in the simulator."""
        if isinstance(message, SliceHead | SliceBody):
            return
        said = self._said.setdefault(station, _Said())
        is_new = self._shows_more(station, said, message)
        _, before = self._last_read.get(station, (b"", None))
        memory = self._memory(station) if is_new or message.term > said.term else None
        said.term = max(said.term, message.term)
        if memory is not None:
            was_so = before is not None and not self._facts(before, message)
            facts = [] if was_so else self._facts(memory, message)
            if memory.phase is None:
                self._none_entered_ns[station] = t_ns
            if facts and (self._was_held(station, message) or self._was_first(t_ns, station, message)):
                facts = []
            self._tell(t_ns, station, _numbers(said, memory) + facts)

    def manager_copied(self, station: str, twin: str) -> None:
        """Note that the manager `twin` is about to start with a copy of the journal of the manager `station`."""
        self._said[twin] = replace(self._said.get(station, _Said()))
        self._prepared = {epoch: "" if first == twin else first for epoch, first in self._prepared.items()}

    def manager_died(self, t_ns: int, station: str) -> None:
        """Verify that a dead manager's journal has its highest term, and has reserved its last new epoch number."""
        said, memory = self._said.get(station), self._memory(station)
        if said is not None and memory is not None:
            self._tell(t_ns, station, _numbers(said, memory))

    def _memory(self, manager: str) -> Memory | None:
        data = self._read(manager)
        if data is None:
            return None
        read, memory = self._last_read.get(manager, (b"", None))
        if memory is None or read != data:
            memory, _ = recovered(data)
            self._last_read[manager] = data, memory
        return memory

    def _was_held(self, manager: str, message: ManagementMessage) -> bool:
        """Tell whether a HOLDS agrees with an earlier state of the manager's journal.

        The earlier states are the journal without its last line, without its last two lines, and so on up to
        `_WAITED` lines. A record takes several lines.

        Returns False for any other message than HOLDS.
        """
        if not isinstance(message, Control) or message.operation is not Operation.HOLDS:
            return False
        lines = self._last_read[manager][0].splitlines(keepends=True)
        lately = (recovered(b"".join(lines[:end]))[0] for end in range(max(1, len(lines) - _WAITED), len(lines)))
        if message.a == ElementKind.PHASE:  # the first lines of a rewritten journal name no phase
            return any(memory.phase == self._phases[message.b] for memory in lately)
        return any(not self._facts(memory, message) for memory in lately)

    def _was_first(self, t_ns: int, manager: str, message: ManagementMessage) -> bool:
        """Tell whether `message` names the spec's first phase, and may have been made before the journal named a phase.

        The first phase is not written to the journal: the journal names no phase until another phase is entered. A
        frame waits for at most `_FIRST_PHASE_NS` before it is sent.
        """
        is_first = isinstance(message, Control) and (message.a, message.b) == (ElementKind.PHASE, 0)
        return is_first and t_ns - self._none_entered_ns.get(manager, -_FIRST_PHASE_NS) < _FIRST_PHASE_NS

    def _tell(self, t_ns: int, manager: str, stories: list[str]) -> None:
        self.violations += [Violation(t_ns, "journal", f"{manager} {story}") for story in stories]

    def _is_first(self, epoch: int, manager: str) -> bool:
        """Record that a manager prepares an epoch; return True if no other manager has prepared it before."""
        return self._prepared.setdefault(epoch, manager) == manager

    def _shows_more(self, manager: str, said: _Said, message: ManagementMessage) -> bool:
        """Record the epoch of a PREPARE or LEASE; return True if the journal must agree with the command.

        The journal must agree with three kinds of commands:

        - a PREPARE whose epoch no other manager has prepared before, and whose epoch and digest are not those of the
          last recorded LEASE
        - a LEASE with a step after PREPARED, whose epoch and digest are not those of the last recorded LEASE
        - every HOLDS and CLEAR
        """
        match message:
            case Prepare(_, epoch, digest) if (epoch, digest) != said.leased and self._is_first(epoch, manager):
                said.prepared = epoch
            case Lease(_, epoch, step, digest) if step is not Step.PREPARED and (epoch, digest) != said.leased:
                said.leased = epoch, digest
            case Control(_, _, Operation.HOLDS | Operation.CLEAR, _, _):
                pass
            case _:
                return False
        return True

    def _facts(self, memory: Memory, message: ManagementMessage) -> list[str]:
        match message:
            case Lease(_, epoch) if epoch == self._switched_by:
                pass
            case Lease(_, epoch, step, digest) if step is not Step.PREPARED:
                runs = memory.runs
                is_known = runs is not None and (
                    is_newer(runs.epoch, epoch) or (runs.epoch, runs.digest) == (epoch, digest)
                )
                if not is_known:
                    return [f"sends that epoch {epoch} runs, but its journal has {runs}"]
            case Control(_, _, Operation.HOLDS, ElementKind.PHASE, index):
                if memory.phase not in (None, self._phases[index]):
                    return [f"sends phase {self._phases[index]}, but its journal has {memory.phase}"]
            case Control(_, _, Operation.HOLDS | Operation.CLEAR, told, _) if told & 0xFF == ElementKind.PRIORITY:
                return self._priority(memory, message)
            case Control(_, _, Operation.HOLDS, ElementKind.SCRIPT | ElementKind.SPEC, _):
                pass  # a script ends with its mastership, and a journal is of one spec: no journal has it
            case Control(_, _, Operation.HOLDS | Operation.CLEAR as operation, a, index):
                element = self._places.told(a, index)
                if (element in memory.latched) is not (operation is Operation.HOLDS):
                    said = Operation(operation).name
                    return [f"sends {said} of {element}, but its journal latches {sorted(memory.latched)}"]
        return []

    def _priority(self, memory: Memory, told: Control) -> list[str]:
        function = self._functions[told.a >> 8]
        held = memory.priorities.get(function)
        number = None if held is None else held.priority | (BY_OPERATOR if held.by_operator else 0)
        if number == (told.b if told.operation is Operation.HOLDS else None):
            return []
        return [
            f"sends {Operation(told.operation).name} of priority {told.b} of {function}, but its journal has {held}"
        ]


def _numbers(said: _Said, memory: Memory) -> list[str]:
    """Return a sentence on each number that a manager has used before the number was on its disk."""
    stories = []
    if memory.term < said.term:
        stories.append(f"has used term {said.term}, but its journal has {memory.term}")
    if said.prepared != NO_EPOCH and is_newer(said.prepared, memory.reserved.get(EPOCHS, NO_EPOCH)):
        stories.append(f"has prepared epoch {said.prepared}, but the highest reserved is {memory.reserved.get(EPOCHS)}")
    return stories
