"""What modules report of PEs and buses: suspicions, which the manager assesses by its own evidence.

A module sees a device that it drives, or another module whose data it reads. If a PE or a bus fails, the module only
sees that some data do not come. So a report alone makes no PE and no bus count as failed:

    a PE                     the manager sends it a PING. If the PE answers, it stays available; if it is silent, it is
                             lost like any other PE (`health`)
    the manager's own bus    works, since it has carried the report
    any other bus            leads to PEs that can be reached only over this bus, since the buses form a forest. If one
                             of these PEs is available, the bus works. If all of them are lost, the plan does without
                             them already, and they can come back at any time

The event `suspicion` reports each suspicion with the evidence, and the event `suspicion_assessed` reports what was
found. A PE repeats its report every second while its module sees the fault, so a lost or doubled report changes
nothing. A forged report only leads to a PING. A manager that restarts forgets suspicions.
"""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_manager import events
from heronry_manager.core.membership import Health
from heronry_manager.core.turn import Turn
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS


class Suspicions:
    """Keeps the PEs and buses that modules suspect, and reports what the manager finds out about them."""

    def __init__(self, spec: Spec, turn: Turn, health: Health) -> None:
        self._spec, self._turn, self._health = spec, turn, health
        self._told_ns: dict[tuple[str, str], int] = {}  # by element and the PE that reports it: the last report
        self._asked: set[str] = set()  # PEs that owe an answer

    def pe(self, pe: str, by: str) -> bool:
        """Note that the PE `by` reports a failure of the PE `pe`; tells whether the manager must PING `pe` now."""
        element = f"pe:{pe}"
        is_new = self._note(element, by)
        if not self._health.is_available(pe):
            if is_new:
                self._tell(element, by, "it counts as lost already")
            return False
        if is_new:
            self._tell(element, by, "it was heard in time, and is asked")
            self._asked.add(pe)
        return is_new

    def answered(self, pe: str) -> None:
        """Note that a state of a PE has come; if a PING was sent to the PE, an event reports that the PE answers."""
        if pe in self._asked:
            self._asked.remove(pe)
            self._conclude(f"pe:{pe}", "it answers, and stays")

    def bus(self, bus: str, by: str) -> None:
        """Note that the PE `by` reports a failure of a bus.

        If the report is new, emit two events. The first has the report, and this manager's evidence that the bus
        carries frames, or says that there is no such evidence. The second has the conclusion.
        """
        element = f"bus:{bus}"
        if not self._note(element, by):
            return
        evidence = self._carries(bus)
        self._tell(element, by, evidence or "no PE is heard that can be reached over it alone")
        self._conclude(element, "it stays" if evidence is not None else "no plan uses it before a PE behind it is back")

    def beat(self) -> None:
        """End the suspicion of each PE that was sent a PING, has not answered, and counts as lost by now.

        Reports from CHANNEL_FORGOTTEN_NS ago or earlier are forgotten: a repetition of such a report counts as new.
        """
        for pe in sorted(pe for pe in self._asked if not self._health.is_available(pe)):
            self._asked.remove(pe)
            self._conclude(f"pe:{pe}", "it does not answer, and is lost")
        oldest_ns = self._turn.now_ns - CHANNEL_FORGOTTEN_NS
        self._told_ns = {key: at_ns for key, at_ns in self._told_ns.items() if at_ns > oldest_ns}

    def _carries(self, bus: str) -> str | None:
        """Return the evidence that a bus carries frames, in words; None: there is none."""
        if bus == self._spec.manager.bus:
            return "it has carried the report"
        near = survivors(self._spec, Situation(frozenset({f"bus:{bus}"}))).pe_cpu_millis
        beyond = next((pe for pe in self._spec.pes if pe not in near and self._health.is_available(pe)), None)
        return None if beyond is None else f"pe:{beyond} is heard, which can be reached over it alone"

    def _note(self, element: str, by: str) -> bool:
        """Note a report on an element; tells whether the report is new, and no repetition."""
        is_new = (element, by) not in self._told_ns
        self._told_ns[element, by] = self._turn.now_ns
        return is_new

    def _tell(self, element: str, by: str, evidence: str) -> None:
        self._turn.emit(events.Suspicion, element=element, by=by, evidence=evidence)

    def _conclude(self, element: str, found: str) -> None:
        self._turn.emit(events.SuspicionAssessed, element=element, found=found)
