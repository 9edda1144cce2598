"""Faults that were reported: each is latched under the name of the element that failed (protocol rule 8).

    well      no fault is reported
    latched   a PE or the operator has reported a fault: the element counts as down. Repeated reports have no
              effect, and only the operator clears the element (`clear`). If the operator has declared an element
              failed, and a PE then reports it, the report of the PE replaces the operator's: the PE may have
              stopped the element. A lack of code gives way: any other fault, and an order, replaces it

*Modules.* A module with several possible PEs has a place on each of them, `module:NAME@PE`. If it fails on one PE, its
place there is latched, and plans use the module on other PEs (`where`). The module is down everywhere in two cases:

- It fails on a second PE. (A PE on which the code of the module is missing does not count as a second one.)
- Another module, which watches the output of this module, reports that this module has failed.

A module with one possible PE has no places, and is down at its first failure.

*Lost, late, doubled and forged reports.* A PE repeats its report until it is acknowledged, so a report that is lost, or
sent during a pause, comes again. A report that comes after the operator has cleared the element latches the element
again; a fault that persists would be found again anyway. A doubled report has no effect. A forged report takes the
element out of use until the operator clears it. After a restart, everything but the times of the faults is remembered.
"""

from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_dg.situation import is_place, module_of, places
from heronry_wire.element_places import element_field, kind_and_place
from heronry_wire.management import EVERYWHERE, ElementKind, FaultCode

OPERATOR_CODE = "OPERATOR"  # of a fault that no PE has reported: the element goes on running until a plan leaves it out
HELD_CODE = "HOLDS"  # of a fault that another manager announces, without the PE that has reported it
LACK_CODE = FaultCode.MODULE_MISSING.name
_OF_NO_PE = (OPERATOR_CODE, HELD_CODE)
_KINDS = {kind.name.lower(): kind for kind in ElementKind}
_FAILED_THERE = frozenset(
    (FaultCode.MODULE_EXCEPTION, FaultCode.MODULE_OVERRUN, FaultCode.PARTITION_ENDED, FaultCode.STALE)
)
_FAILED_CODES = frozenset(code.name for code in _FAILED_THERE)


@dataclass(frozen=True, slots=True)
class LatchedFault:
    """A fault that counts until the operator clears its element.

    element: the element that has failed, as `kind:name`.
    by: the PE that has reported it, the operator, or another manager that announces it (`manager 126`).
    code: kind of the fault; `detail` depends on it.
    since_ns: when it was reported, on the manager's clock in nanoseconds.
    """

    element: str
    by: str  # a PE, or "the operator"
    code: str  # name of the fault code, or OPERATOR_CODE
    detail: int
    since_ns: int


class LatchedFaults:
    """Keeps the faults that were reported and not cleared."""

    def __init__(self, spec: Spec) -> None:
        self._names: dict[ElementKind, tuple[str, ...]] = {
            ElementKind.PE: tuple(spec.pes),
            ElementKind.DEVICE: tuple(spec.devices),
            ElementKind.MODULE: tuple(spec.modules),
            ElementKind.BUS: tuple(spec.buses),
        }
        self._places = {place for module in spec.modules for place in places(spec, module)}
        self._nodes = {pe.name: pe.node_id for pe in spec.pes.values()}
        self._failed: dict[str, LatchedFault] = {}

    @property
    def elements(self) -> frozenset[str]:
        """The elements on which a fault is latched, each as `kind:name`."""
        return frozenset(self._failed)

    def all(self) -> list[LatchedFault]:
        """Return every latched fault, the oldest first."""
        return list(self._failed.values())

    def element(self, kind: ElementKind, index: int) -> str | None:
        """Return the element that has this kind and index in an EMCY; None: the spec has no such element."""
        names = self._names.get(kind, ())
        return f"{kind.name.lower()}:{names[index]}" if index < len(names) else None

    def where(self, element: str, pe: str, code: FaultCode) -> str:
        """Return what counts as failed when a PE reports an element: the element, or only a module's place on that PE.

        Only a module with several possible PEs has places. If it has a place on this PE, only this place counts,
        except in three cases; then the whole module counts:

        - The module itself is latched already.
        - `code` is neither MODULE_MISSING nor a code by which the module has failed on this PE (`_FAILED_THERE`).
        - `code` is one of `_FAILED_THERE`, and the module has failed on another PE by such a code before.
        """
        place = f"{element}@{pe}"
        if place not in self._places or element in self._failed:
            return element
        if code is FaultCode.MODULE_MISSING:
            return place
        others = (one for one in self._of(element) if one.element != place)
        second = any(one.code in _FAILED_CODES for one in others)
        return element if code not in _FAILED_THERE or second else place

    def told(self, a: int, index: int) -> str | None:
        """Return the element that a CONTROL with CLEAR or HOLDS names; None: the spec has no such element.

        a: field a of the CONTROL: the kind of the element, and the node-ID of its place.
        index: index of the element.
        """
        number, node = kind_and_place(a)
        element = self.element(ElementKind(number), index) if number in set(ElementKind) else None
        if node == EVERYWHERE or element is None:
            return element
        pe = next((name for name, one in self._nodes.items() if one == node), "")
        return f"{element}@{pe}" if f"{element}@{pe}" in self._places else None

    def field(self, element: str) -> tuple[int, int] | None:
        """Return the fields a and b by which CONTROL names an element.

        None: it is a channel, which CONTROL cannot name.
        """
        kind, _, name = element.partition(":")
        name, _, pe = name.partition("@")
        names = self._names.get(_KINDS[kind], ()) if kind in _KINDS else ()
        if name not in names:
            return None
        return element_field(_KINDS[kind], self._nodes[pe] if pe else EVERYWHERE), names.index(name)

    def latch(self, fault: LatchedFault) -> bool:
        """Keep a fault, unless one is latched on the same element already; tells whether it was kept.

        There are three exceptions: a PE's report replaces a fault that only the operator has reported; for a place, it
        also replaces a fault that only another manager has announced. Whoever reports a lack of code replaces no order,
        and a lack is replaced by any other fault and by an order: they stay when the code comes.
        """
        before = self._failed.get(fault.element)
        if before is not None and before.code == LACK_CODE:
            if fault.code in (LACK_CODE, HELD_CODE):
                return False
        elif before is not None:
            if fault.code == LACK_CODE and before.code == OPERATOR_CODE:
                return False
            weaker = _OF_NO_PE if is_place(fault.element) else (OPERATOR_CODE,)
            if before.code not in weaker or fault.code in _OF_NO_PE:
                return False
        self._failed[fault.element] = fault
        return True

    def clear(self, element: str) -> list[LatchedFault]:
        """Clear an element and, if it is a module, all its places; gives the faults that were latched on them."""
        cleared = [one for one in self._failed.values() if one.element == element] + self._of(element)
        for one in cleared:
            del self._failed[one.element]
        return cleared

    def code(self, element: str) -> str | None:
        """Return the code of the fault that is latched on exactly this element; None: there is none."""
        return self._failed[element].code if element in self._failed else None

    def end_order(self, element: str) -> bool:
        """End the fault on exactly this element if the operator alone has declared it; tells whether it ended."""
        is_ordered = self.code(element) == OPERATOR_CODE
        if is_ordered:
            del self._failed[element]
        return is_ordered

    def _of(self, module: str) -> list[LatchedFault]:
        """Return the faults that are latched on single places of a module."""
        return [one for one in self._failed.values() if is_place(one.element) and module_of(one.element) == module]
