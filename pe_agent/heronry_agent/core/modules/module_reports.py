"""What the modules of one PE tell the manager: failed elements, requests for phases and priorities, their own faults.

A report of a failed element becomes a fault. While this PE holds back its exclusive outputs, and for a second after
that, it accepts no report that an element has failed: a surface that no PE drives does not follow its command, although
its servo is healthy. The reporting module is started anew, to forget what it saw.

A name that the spec does not have is counted; that of an element is also told, once a second (`notices`).
"""

from collections.abc import Mapping

from heronry_agent.core.authority import OutputAuthorization
from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.modules.notices import Notices
from heronry_agent.core.modules.phase_requests import PhaseRequests
from heronry_agent.core.modules.priority_requests import PriorityRequests
from heronry_agent.core.reports import Faults
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import StartModule, Stepped
from heronry_agent.module import DISAGREEMENT, Value
from heronry_wire.frame import Frame
from heronry_wire.management import SPECS_PRIORITY, ElementKind, FaultCode
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import Send

EVALUATED_AFTER_NS = 1_000_000_000


class ModuleReports:
    """Sends the reports and requests of the modules of one PE."""

    def __init__(
        self, turn: Turn, index: TableIndex, faults: Faults, output_authorization: OutputAuthorization
    ) -> None:
        """Begin with nothing to tell."""
        self._turn, self._index, self._faults = turn, index, faults
        self._output_authorization = output_authorization
        self.phase_requests = PhaseRequests(index, faults)
        self._priority_requests = PriorityRequests(faults)
        self.notices = Notices(turn, index)
        self._held_ns = -EVALUATED_AFTER_NS  # when an exclusive output was last held back

    def carry_over(self, carried: CarriedOver, modes: Mapping[int, int]) -> None:
        """Take the indices of another table; `modes`: mode of each module that goes on."""
        self.phase_requests.carry_over(carried, modes)
        self._priority_requests.carry_over(carried)
        self.notices.forget()

    def stopped(self, module: int) -> None:
        """Withdraw the requests of a module that stops."""
        self.phase_requests.stopped(module)
        self._priority_requests.stopped(module)

    def held(self) -> None:
        """Note that an exclusive output is held back now."""
        self._held_ns = self._turn.now_ns

    def take(self, entry: ModuleEntry, mode: int, event: Stepped, *, has_exclusive_output: bool) -> None:
        """Process what a step of a module reports and requests; has_exclusive_output: whether this PE has one."""
        for element, detail in event.reports:
            self._report(entry, mode, element, detail, has_exclusive_output)
        for phase in event.phases:
            self._request_phase(entry, phase)
        for function, priority in event.priorities:
            self._request_priority(entry, function, priority)

    def gave(self, module: int, variable: str, value: Value) -> None:
        """Apply the phase rules of a variable to the value that a module has given."""
        self.tell(self.phase_requests.gave(module, variable, value, self._turn.now_ns))

    def new_mastership(self) -> None:
        """Send the standing requests again, because the manager of a new term may have missed them."""
        now_ns = self._turn.now_ns
        self.tell(self.phase_requests.new_mastership(now_ns))
        self.tell(self._priority_requests.new_mastership(now_ns))

    def found(self, code: FaultCode, kind: ElementKind, position: int, detail: int) -> bool:
        """Report a fault of an element, by its index; tells whether it is sent now (`Faults.found`)."""
        frames = self._faults.found(code, kind, position, detail, self._turn.now_ns)
        self.tell(frames)
        return bool(frames)

    def tell(self, frames: list[Frame]) -> None:
        """Send frames toward the manager."""
        self._turn.do(*(Send(self._index.uplink, frame) for frame in frames))

    def _report(self, entry: ModuleEntry, mode: int, element: str, detail: int, has_exclusive_output: bool) -> None:
        if element == DISAGREEMENT:
            self.notices.send(entry.index, FaultCode.DISAGREEMENT, detail)
            return
        found = self._index.elements.get(element)
        if found is None:
            self._turn.count("report of an unknown element", entry.index)
            if self.notices.send(entry.index, FaultCode.UNKNOWN_ELEMENT, detail):
                self._turn.note("fault", f"module {entry.name} reports {element}, which the spec does not have")
            return
        if has_exclusive_output and not self._output_authorization.allows(self._turn.now_ns):
            self.held()
        if self._turn.now_ns < self._held_ns + EVALUATED_AFTER_NS:
            self._turn.count("report while outputs are held", entry.index)
            self._turn.do(StartModule(entry.index, entry, mode))
            return
        if self.found(FaultCode.REPORTED, *found, detail):
            self._turn.note("fault", f"module {entry.name} reports {element} failed, detail {detail}")

    def _request_phase(self, entry: ModuleEntry, phase: str) -> None:
        index = self._index.phase_index.get(phase)
        if index is None:
            self._turn.count("request of an unknown phase", entry.index)
            return
        frames = self.phase_requests.requested(entry.index, index, self._turn.now_ns)
        if frames:
            self._turn.note("phase", f"module {entry.name} asks for phase {phase}")
        self.tell(frames)

    def _request_priority(self, entry: ModuleEntry, function: str, priority: int) -> None:
        index = self._index.table.adjustable.get(function)
        if index is None:
            self._turn.count("request for a priority that is not to be changed", entry.index)
            return
        frames = self._priority_requests.requested(entry.index, index, priority, self._turn.now_ns)
        if frames:
            wanted = "that of the spec" if priority == SPECS_PRIORITY else priority
            self._turn.note("priority", f"module {entry.name} asks for priority {wanted} of {function}")
        self.tell(frames)
