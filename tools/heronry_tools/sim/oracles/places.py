"""Finds which element counts as failed after a PE's report. The oracles derive it from frames, as a manager does.

    what the PE reports                               what counts as failed
    a module on this PE has failed                    the module on this PE only (`module:NAME@PE`), if other
                                                      PEs can run it, too; otherwise the module
    the same, after the module failed on another PE   the module on all PEs
    the code of a module is missing on this PE        the module on this PE only, even if other PEs report
                                                      the same
    one of its modules reports another module         the reported module, on all PEs
    one of its modules reports a device               the reported device
    one of its modules reports a PE or a bus          nothing, since this is only a suspicion

A report names an element by its kind and index. CLEAR and HOLDS of `module:NAME@PE` also have the PE's node-ID.
"""

from heronry_dg.model import Spec
from heronry_dg.situation import module_of, places
from heronry_tools.recording.commanded import elements_by_kind
from heronry_wire.management import ElementKind, Emergency, FaultCode

_BY_OTHERS = (FaultCode.REPORTED,)
_SUSPECTED = (ElementKind.PE, ElementKind.BUS)


class Places:
    """Finds the names of the elements in reports and commands."""

    def __init__(self, spec: Spec) -> None:
        self._elements = elements_by_kind(spec)
        self._all = {place for module in spec.modules for place in places(spec, module)}
        self._pe_of_node = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._codes: dict[tuple[str, int, int], FaultCode] = {}  # of the last report, by PE, kind and index
        self._failed: set[str] = set()  # places on which a module has failed, without missing code

    def reported(self, pe: str, message: Emergency) -> str | None:
        """Record a report of a PE.

        Returns the element or place that the report names; None if the spec has no such element.
        """
        self._codes[pe, message.kind, message.index] = message.code
        element = self._element(message.kind, message.index)
        place = f"{element}@{pe}"
        return place if place in self._all and message.code not in _BY_OTHERS else element

    def acknowledged(self, node: int, a: int, index: int) -> str | None:
        """Return the element or place that counts as failed when a manager acknowledges a report.

        None: the report was only a suspicion, or the spec has no such element.

        node: node-ID of the PE that has reported. a, index: kind and index of the element, as in the command.
        """
        if a in _SUSPECTED:
            return None
        pe = self._pe_of_node.get(node, "")
        element, code = self._element(a, index), self._codes.get((pe, a, index))
        place = f"{element}@{pe}"
        if place not in self._all or code is None or code in _BY_OTHERS:
            return element
        if code is FaultCode.MODULE_MISSING:
            return place
        self._failed.add(place)
        others = [one for one in self._failed if module_of(one) == element and one != place]
        return element if others else place

    def told(self, a: int, index: int) -> str | None:
        """Return the element or place that a CLEAR or HOLDS names; None if the spec has no such element.

        a, index: fields of the command.
        """
        element, pe = self._element(a & 0xFF, index), self._pe_of_node.get(a >> 8)
        return element if pe is None or element is None else f"{element}@{pe}"

    def cleared(self, element: str) -> None:
        """Forget the failures of an element; of a module, also those on single PEs."""
        self._failed = {place for place in self._failed if element not in (place, module_of(place))}

    def _element(self, kind: int, index: int) -> str | None:
        names = self._elements.get(ElementKind(kind), []) if kind in set(ElementKind) else []
        return names[index] if index < len(names) else None
