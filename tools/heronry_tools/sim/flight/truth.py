"""What is really so in one flight: what was done to the aircraft is known here and nowhere else.

Down is what has failed, what is cut off, what the operator has declared failed, and what was reported for a reason
(`excuse`, or while a fault is present under which a module's report cannot be promised).
"""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.oracles.waivers import REPORTS, Waivers


class Truth:
    """The situation as it is."""

    def __init__(self, spec: Spec, checks: Checks, waivers: Waivers) -> None:
        """Begin with an aircraft on which nothing has failed."""
        self._spec, self._checks, self._waivers = spec, checks, waivers
        self._down: set[str] = set()
        self._cut: set[str] = set()
        self.declared: dict[str, int] = {}  # elements that the operator declared failed; the term that was told last
        self.excusable: set[str] = set()  # elements that may be reported although they have not failed

    @property
    def situation(self) -> Situation:
        """What is down, and the phase that was requested last."""
        excused = {
            element
            for element, t_ns in self._checks.reported.items()
            if element in self.excusable or self._waivers.cover(REPORTS, t_ns)
        }
        down = frozenset(self._down | self._cut | self.declared.keys() | excused)
        return Situation(down, {}, self._checks.phase)

    def failed(self, element: str) -> None:
        """Note that an element has failed; what was cut off and fails is not cut off any more."""
        self._down.add(element)
        self._cut.discard(element)

    def is_back(self, element: str) -> None:
        """Note that an element works again, and is not cut off."""
        self._down.discard(element)
        self._cut.discard(element)

    def cut(self, element: str) -> None:
        """Note that an element lives, and nothing reaches it."""
        self._cut.add(element)

    def mended(self, element: str) -> None:
        """Note that an element can be reached again."""
        self._cut.discard(element)

    def excuse(self, module: str) -> None:
        """Let a module be reported, and its device: a servo that no module drives looks like one that is stuck.

        Where no branch of a DEMUX is left, its surface stands still, and so do the sensors beside it.
        """
        spec, excusable = self._spec, self.excusable
        devices = {spec.modules[module].device}
        excusable.add(f"module:{module}")
        for function in spec.functions.values():
            branches = function.outputs
            if module in branches and len(branches) > 1 and all(f"module:{branch}" in excusable for branch in branches):
                places = {spec.devices[device].pe for branch in branches if (device := spec.modules[branch].device)}
                devices |= {one.name for one in spec.devices.values() if one.kind == "sensor" and one.pe in places}
        excusable |= {f"device:{device}" for device in devices if device is not None}
