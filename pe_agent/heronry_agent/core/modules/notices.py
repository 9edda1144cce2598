"""Notices of modules that are not faults: EMCYs that nobody acknowledges, and that repeat while their cause lasts.

A cause shows in each step of its module, up to a hundred times a second. So a notice of one kind about one module is
sent once a second.
"""

from collections.abc import Collection

from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.unknown_names import misspelt_output
from heronry_agent.core.vocabulary import Stepped
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.protocol_times import FAULT_QUIET_NS
from heronry_wire.sansio import Send


class Notices:
    """Sends the notices of one PE."""

    def __init__(self, turn: Turn, index: TableIndex) -> None:
        self._turn, self._index = turn, index
        self._sent_ns: dict[tuple[int, FaultCode], int] = {}  # by module and code

    def forget(self) -> None:
        """Forget what was sent: with another table modules have other indices."""
        self._sent_ns.clear()

    def send(self, module: int, code: FaultCode, detail: int) -> bool:
        """Send a notice about a module, unless one with this code was sent in the last second; tells whether it was."""
        now_ns = self._turn.now_ns
        if now_ns - self._sent_ns.get((module, code), -FAULT_QUIET_NS) < FAULT_QUIET_NS:
            return False
        self._sent_ns[module, code] = now_ns
        notice = Emergency(code, 0, ElementKind.MODULE, module, detail)
        self._turn.do(Send(self._index.uplink, Frame(emcy_id(self._index.node), notice.encode())))
        return True

    def look_for_misspelt(self, entry: ModuleEntry, event: Stepped, missing: Collection[str]) -> None:
        """Report a misspelt output or input of a step; `missing`: outputs of the mode that it has left out."""
        output = misspelt_output(entry, missing, event.outputs)
        read = next(iter(event.misspelt_inputs), None)
        for code, verb, found in (
            (FaultCode.UNKNOWN_OUTPUT, "gives", output),
            (FaultCode.UNKNOWN_INPUT, "reads", read),
        ):
            if found is not None and self.send(entry.index, code, 0):
                self._turn.note("fault", f"module {entry.name} {verb} '{found[0]}'; did you mean '{found[1]}'?")
