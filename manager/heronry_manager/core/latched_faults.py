"""Faults that were reported: each is latched by the element that failed (protocol rule 8).

    well      no fault is reported
    latched   a PE or the operator has reported a fault: the element counts as down. Repeated reports have no effect,
              and only the operator clears the element (`clear`). A PE's report on an element that the operator has
              failed replaces the operator's report: that PE may have stopped the element

Lost, or sent during a pause: a PE repeats its report until it is acknowledged. Late: a report that comes after the
operator has cleared the element latches it again; a fault that persists would be found again anyway. Doubled: no
effect. Forged: the report takes the element out of use until the operator clears it. A restart remembers all but the
times of the faults.
"""

from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_wire.management import ElementKind

OPERATOR_CODE = "OPERATOR"  # of a fault that no PE has reported: the element goes on running until a plan leaves it out
HELD_CODE = "HOLDS"  # of a fault that another manager announces, without the PE that has reported it
_OF_NO_PE = (OPERATOR_CODE, HELD_CODE)
_KINDS = {kind.name.lower(): kind for kind in ElementKind}


@dataclass(frozen=True, slots=True)
class LatchedFault:
    """One element that counts as failed: which node reported it, why, and when (the manager's clock)."""

    element: str
    by: str  # a PE, or "the operator"
    code: str  # name of the fault code, or OPERATOR_CODE
    detail: int
    since_ns: int


class LatchedFaults:
    """Elements that have been reported failed."""

    def __init__(self, spec: Spec) -> None:
        self._names: dict[ElementKind, tuple[str, ...]] = {
            ElementKind.PE: tuple(spec.pes),
            ElementKind.DEVICE: tuple(spec.devices),
            ElementKind.MODULE: tuple(spec.modules),
            ElementKind.BUS: tuple(spec.buses),
        }
        self._failed: dict[str, LatchedFault] = {}

    @property
    def elements(self) -> frozenset[str]:
        """Elements that have failed, as `kind:name`."""
        return frozenset(self._failed)

    def all(self) -> list[LatchedFault]:
        """Give every latched fault, the oldest first."""
        return list(self._failed.values())

    def element(self, kind: ElementKind, index: int) -> str | None:
        """Give the element that an EMCY names; None: the spec has no such element."""
        names = self._names.get(kind, ())
        return f"{kind.name.lower()}:{names[index]}" if index < len(names) else None

    def place(self, element: str) -> tuple[ElementKind, int] | None:
        """Give the kind and index by which CONTROL names an element; None for a channel, which it cannot name."""
        kind, _, name = element.partition(":")
        names = self._names.get(_KINDS[kind], ()) if kind in _KINDS else ()
        return (_KINDS[kind], names.index(name)) if name in names else None

    def latch(self, fault: LatchedFault) -> bool:
        """Latch a fault; tells whether it is kept: the element was not latched, or only by the operator."""
        before = self._failed.get(fault.element)
        if before is not None and (before.code != OPERATOR_CODE or fault.code in _OF_NO_PE):
            return False
        self._failed[fault.element] = fault
        return True

    def clear(self, element: str) -> LatchedFault | None:
        """Clear an element; gives the fault that was latched on it, or None."""
        return self._failed.pop(element, None)
