"""A manager's journal, read back, is what its frames show: at every moment at which they show something new.

A manager that restarts knows no more than the bytes on its disk. They are read again as that manager would
(`recovered`), and compared with what it has sent, in that mastership:

    term         a frame that names a term: the journal has it, or a higher one. A term that is not on the disk before
                 it is used might be used twice
    epochs       a PREPARE of a number that no manager has prepared before, and that is not what this manager has
                 adopted: it lies within what is reserved
    what runs    a LEASE that names another epoch, from BREAK on: the journal has this epoch with this digest
    phase        HOLDS of a phase: it is that one
    faults       HOLDS of an element: it is latched; CLEAR: it is not

When a manager has died (`died`) the numbers are compared again, with what a power cut has left: they were synced before
they were used. Facts may go with the power.

A manager that is started on a copy of another one's disk (`copied`) answers for what that one has sent until then, and
for nothing that was sent before on the disk that it had at another time.

Not verified: a disk that takes nothing (the caller gives no bytes), a manager that only follows and has sent nothing
yet, and what a deposed manager sends (the caller tells nothing of it). A frame that waited may be older than the
journal: an epoch is then older, and not another; a phase and a fault are as the journal had them when it was last read,
or in one of the last records that are there.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from heronry_dg.model import Spec
from heronry_manager.core.memory import EPOCHS, Memory
from heronry_manager.shell.journal import recovered
from heronry_tools.sim.oracles.commanded import elements_by_kind
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import (
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

_WAITED = 8 * 3  # lines of records that may be written while a frame waits: both copies, and an empty one
_FIRST_PHASE_NS = 1_000_000_000  # for which a frame may wait that names it
Read = Callable[[str], bytes | None]  # bytes on the disk of a station's manager; None where nothing is promised of them


@dataclass(slots=True)
class _Said:
    """What one manager has sent, over all its masterships."""

    term: int = 0
    prepared: int = NO_EPOCH
    leased: tuple[int, int] = (NO_EPOCH, 0)


class JournalCheck(Oracle):
    """Compares what managers send with what they have written."""

    def __init__(self, spec: Spec, read: Read) -> None:
        super().__init__()
        self._read = read
        self._names = elements_by_kind(spec)
        self._phases = list(spec.phases)
        self._said: dict[str, _Said] = {}  # by station
        self._prepared: dict[int, str] = {}  # by epoch: the station that prepared it first, "" on a former disk
        self._none_entered_ns: dict[str, int] = {}  # by station: when its journal named no phase yet, last
        self._last_read: dict[str, tuple[bytes, Memory]] = {}  # by station: bytes on its disk, and what they hold

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """A manager, known by its station, was heard."""
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
        """A twin of a manager is about to start, with a copy of that one's disk."""
        self._said[twin] = replace(self._said.get(station, _Said()))
        self._prepared = {epoch: "" if first == twin else first for epoch, first in self._prepared.items()}

    def manager_died(self, t_ns: int, station: str) -> None:
        """A manager has died; what it finds when it starts again is on its disk now."""
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
        """Tell whether what a manager sends with HOLDS was so a few records ago."""
        if not isinstance(message, Control) or message.operation is not Operation.HOLDS:
            return False
        lines = self._last_read[manager][0].splitlines(keepends=True)
        lately = (recovered(b"".join(lines[:end]))[0] for end in range(max(1, len(lines) - _WAITED), len(lines)))
        if message.a == ElementKind.PHASE:  # of a journal that was written anew the first lines name none
            return any(memory.phase == self._phases[message.b] for memory in lately)
        return any(not self._facts(memory, message) for memory in lately)

    def _was_first(self, t_ns: int, manager: str, message: ManagementMessage) -> bool:
        """Tell whether HOLDS names the first phase, which has no record, and no other was entered lately."""
        is_first = isinstance(message, Control) and (message.a, message.b) == (ElementKind.PHASE, 0)
        return is_first and t_ns - self._none_entered_ns.get(manager, -_FIRST_PHASE_NS) < _FIRST_PHASE_NS

    def _tell(self, t_ns: int, manager: str, stories: list[str]) -> None:
        self.violations += [Violation(t_ns, "journal", f"{manager} {story}") for story in stories]

    def _is_first(self, epoch: int, manager: str) -> bool:
        """Note that a manager prepares an epoch; tells whether it was the first to do so."""
        return self._prepared.setdefault(epoch, manager) == manager

    def _shows_more(self, manager: str, said: _Said, message: ManagementMessage) -> bool:
        """Note a command; tells whether it shows anything new."""
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
            case Lease(_, epoch, step, digest) if step is not Step.PREPARED:
                runs = memory.runs
                is_known = runs is not None and (
                    is_newer(runs.epoch, epoch) or (runs.epoch, runs.digest) == (epoch, digest)
                )
                if not is_known:
                    return [f"sends that epoch {epoch} runs, and its journal has {runs}"]
            case Control(_, _, Operation.HOLDS, ElementKind.PHASE, index):
                if memory.phase not in (None, self._phases[index]):
                    return [f"holds phase {self._phases[index]}, and its journal has {memory.phase}"]
            case Control(_, _, Operation.HOLDS | Operation.CLEAR as operation, kind, index):
                element = self._names[ElementKind(kind)][index]
                if (element in memory.latched) is not (operation is Operation.HOLDS):
                    return [f"sends {operation.name} of {element}, and its journal has {sorted(memory.latched)}"]
        return []


def _numbers(said: _Said, memory: Memory) -> list[str]:
    """What is wrong with the numbers: none may be used that is not on the disk."""
    stories = []
    if memory.term < said.term:
        stories.append(f"has used term {said.term}, and its journal has {memory.term}")
    if said.prepared != NO_EPOCH and is_newer(said.prepared, memory.reserved.get(EPOCHS, NO_EPOCH)):
        stories.append(f"has prepared epoch {said.prepared}, and has reserved {memory.reserved.get(EPOCHS)}")
    return stories
