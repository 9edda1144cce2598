"""The real situation of one flight, known only to the simulator and its oracles.

An element is down if it has failed, is cut off, or was declared failed by the operator. A healthy element is down, too,
if a PE has reported it as failed and this false report is excused. `excuse` excuses reports about one module and its
device. A fault of some kinds (`Kind.excuses`) excuses every report while it is present. As in the manager, a module
that has failed on one PE is down on this PE. When it has failed on a second PE, it is down everywhere. What the spec by
which the aircraft flies does not have is left out.
"""

from collections import Counter

from heronry_dg.situation import Situation, is_place, module_of, places
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.oracles.flown_spec import all_elements
from heronry_tools.sim.oracles.waivers import REPORTS, Waivers


class Truth:
    """The real situation of one flight, as the simulator causes it."""

    def __init__(self, checks: Checks, waivers: Waivers) -> None:
        """Begin with an aircraft on which everything is healthy."""
        self._checks, self._waivers = checks, waivers
        self._known = checks.spec, all_elements(checks.spec)
        self._down: set[str] = set()
        self._cut: set[str] = set()
        self.declared: dict[str, int] = {}  # by element declared failed: term of the last order to fail it
        self.excusable: set[str] = set()  # healthy elements that may be reported as failed
        self._lacking: set[str] = set()  # places where the code is missing

    @property
    def situation(self) -> Situation:
        """Return the elements that are down, the phase requested last, and the priorities in force."""
        excused = {
            element
            for element, t_ns in self._checks.reported.items()
            if module_of(element) in self.excusable or self._waivers.cover(REPORTS, t_ns)
        }
        down = self._down | self._cut | self.declared.keys() | excused
        failed = Counter(module_of(place) for place in (self._down | excused) if is_place(place))
        everywhere = {module for module, count in failed.items() if count > 1}
        gone = frozenset(down | everywhere | self._lacking) & self._there()
        return Situation(gone, {}, self._checks.phase, self._checks.priorities)

    def _there(self) -> frozenset[str]:
        """Return the elements and places of the spec by which the aircraft flies."""
        spec = self._checks.spec
        if self._known[0] is not spec:
            self._known = spec, all_elements(spec)
        return self._known[1]

    def broke(self, module: str, pe: str) -> None:
        """Record that a module has failed on a PE.

        The module is then down on this PE. If no other PE can run the module, it is down everywhere.
        """
        self.failed(self._place(module, pe))

    def lacks(self, module: str, pe: str) -> None:
        """Record that a PE lacks the code of a module; clearing the module does not end this."""
        self._lacking.add(self._place(module, pe))

    def has_code(self, t_ns: int, module: str, pe: str) -> None:
        """Record that the code of a module, which a PE lacked, has come, and that a manager ends its fault."""
        place = self._place(module, pe)
        self._checks.cleared(t_ns, place, self.situation, everywhere=False)
        self._lacking.discard(place)

    def _place(self, module: str, pe: str) -> str:
        place = f"module:{module}@{pe}"
        spec = self._checks.spec
        return place if module in spec.modules and place in places(spec, module) else f"module:{module}"

    def failed(self, element: str) -> None:
        """Set an element as failed; it no longer counts as cut off."""
        self._down.add(element)
        self._cut.discard(element)

    def is_back(self, element: str) -> None:
        """Set an element as healthy and not cut off; a module becomes healthy on every PE."""
        self._down = {one for one in self._down if element not in (one, module_of(one))}
        self._cut.discard(element)

    def cut(self, element: str) -> None:
        """Set an element as cut off: it counts as down until `mended` or `is_back` is called.

        An element that has also failed stays down after `mended`.
        """
        self._cut.add(element)

    def mended(self, element: str) -> None:
        """Note that an element is no longer cut off."""
        self._cut.discard(element)

    def excuse(self, module: str) -> None:
        """Allow false reports about a healthy module and about its device.

        The reason: a servo that no module drives may look stuck.

        If a function has several output modules and all of them have been excused, the surface of this function may
        stand still. Then sensors may look stuck, too. So reports are also allowed about every sensor on each PE
        that has a device of one of these output modules.
        """
        spec, excusable = self._checks.spec, self.excusable
        if module not in spec.modules:
            return
        devices = {spec.modules[module].device}
        excusable.add(f"module:{module}")
        for function in spec.functions.values():
            branches = function.outputs
            if module in branches and len(branches) > 1 and all(f"module:{branch}" in excusable for branch in branches):
                places = {spec.devices[device].pe for branch in branches if (device := spec.modules[branch].device)}
                devices |= {one.name for one in spec.devices.values() if one.kind == "sensor" and one.pe in places}
        excusable |= {f"device:{device}" for device in devices if device is not None}
