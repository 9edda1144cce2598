"""Faults that somebody reported: each is latched by the element that failed (protocol rule 8).

An element that has failed stays failed, whoever says so and however often; only an operator's word will clear it.
"""

from heronry_dg.model import Spec
from heronry_wire.management import ElementKind


class LatchedFaults:
    """Elements that have been reported failed."""

    def __init__(self, spec: Spec) -> None:
        self._names: dict[ElementKind, tuple[str, ...]] = {
            ElementKind.PE: tuple(spec.pes),
            ElementKind.DEVICE: tuple(spec.devices),
            ElementKind.MODULE: tuple(spec.modules),
            ElementKind.BUS: tuple(spec.buses),
        }
        self._failed: dict[str, None] = {}

    @property
    def elements(self) -> frozenset[str]:
        """Elements that have failed, as `kind:name`."""
        return frozenset(self._failed)

    def element(self, kind: ElementKind, index: int) -> str | None:
        """Element that an EMCY names; None where the spec has no such one."""
        names = self._names[kind]
        return f"{kind.name.lower()}:{names[index]}" if index < len(names) else None

    def latch(self, element: str) -> bool:
        """Latch a fault; tells whether it is news."""
        news = element not in self._failed
        self._failed[element] = None
        return news
