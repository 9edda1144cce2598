"""No healthy element is reported as failed: every fault that a PE reports on a bus was really injected.

The manager latches a reported fault. So a false report takes a healthy element out of use until the operator clears the
element. The oracle collects the reports, and `unfounded` compares all of them with the elements that are down when it
is called. This is enough, since an element that was rightly reported stays down until it is cleared.

The oracle reads the EMCYs that a PE itself sends, on any bus. An EMCY that a gateway forwards is no new report: either
the oracle has read the EMCY beyond the gateway, or a foreign node has sent it. There is one exception: a late EMCY
about an element that was cleared meanwhile counts as a new report (`handed_on`). With a key no manager believes the
EMCY of a foreign node. If a manager believed such an EMCY, it would plan without a healthy element, and `end_state`
would detect this.

A monitor compares an actuator with a sensor. If the sensor is stuck, the monitor cannot know at once which of the two
has failed, and may report the actuator first. So the report of an actuator is founded, too, if a sensor is down whose
data a module reads together with those of the actuator's driver. And a module that fails by its silence fails rightly
if its device is down.
"""

from itertools import product

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, module_of
from heronry_tools.sim.oracles.flown_spec import all_elements
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.places import Places
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.frame import Malformed
from heronry_wire.management import ElementKind, Emergency, FaultCode, decode_emergency
from heronry_wire.silence import Silence

_REPORTS_NO_FAULT = (
    "RESET",
    "PHASE_REQUEST",
    "PRIORITY_REQUEST",
    "DISAGREEMENT",
    "UNKNOWN_ELEMENT",
    "UNKNOWN_OUTPUT",
    "UNKNOWN_INPUT",
    "MODULE_RESTARTED",
    "CHANNEL_LOST",
    "STATE_RESTORED",
    "STATE_LACKING",
    "CHANNEL_BACK",
)


class BlameCheck(Oracle):
    """Collects the elements that PEs report as failed, and compares them with the injected faults."""

    def __init__(self, spec: Spec) -> None:
        """Begin without reports; the order of elements in `spec` gives the indices in EMCYs."""
        super().__init__()
        self._places = Places(spec)
        self._modules = list(spec.modules.values())
        self._compared = _compared(spec)
        self._reported: dict[str, Violation] = {}
        self._cleared: dict[str, Violation] = {}  # elements that were rightly reported, and have been cleared since

    def take_over(self, before: "BlameCheck", spec: Spec) -> None:
        """Take over the reports of another spec, of the elements that `spec` has, too."""
        there = all_elements(spec)
        self._reported = {element: one for element, one in before._reported.items() if element in there}
        self._cleared = {element: one for element, one in before._cleared.items() if element in there}

    def emergency(self, sent: Sent, _pe: str, _message: Emergency | Malformed) -> None:
        """Read the EMCY of a PE, and record the element that it reports as failed."""
        element, detail = self._reported_by(sent)
        if element is None:
            return
        story = f"{element} is reported by {sent.sender} (detail {detail}), but no fault of it was injected"
        self._reported.setdefault(element, Violation(sent.end_ns, "blame", story))

    def handed_on(self, sent: Sent) -> None:
        """Record again the report of a cleared element, if a gateway forwards a late EMCY about this element.

        The manager takes the late EMCY for a new report.
        """
        element, _ = self._reported_by(sent)
        if element in self._cleared:
            self._reported.setdefault(element, self._cleared[element])

    def cleared(self, _t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:  # noqa: ARG002
        """Drop the reports of a cleared element that was down in `truth`; for a module, also those of its places."""
        for one in [one for one in self._reported if element in (one, module_of(one)) and _is_down(one, truth)]:
            self._cleared[one] = self._reported.pop(one)

    def _reported_by(self, sent: Sent) -> tuple[str | None, int]:
        emergency = decode_emergency(sent.frame.data)
        if isinstance(emergency, Malformed) or emergency.code.name in _REPORTS_NO_FAULT:
            return None, 0
        if emergency.kind in (ElementKind.PE, ElementKind.BUS):  # a suspicion, which the manager assesses
            return None, 0
        if emergency.code is FaultCode.STALE and not self._fails(emergency):
            return None, 0
        element = self._places.reported(sent.sender, emergency)
        return element or f"{emergency.kind.name.lower()}:{emergency.index}", emergency.detail

    def _fails(self, emergency: Emergency) -> bool:
        """Tell whether a module counts as failed by a report of a silence: its output is silent, and the spec says so.

        `stale` verifies all reports of silences.
        """
        silence, module = Silence.of(emergency.detail), self._modules[emergency.index]
        return silence.is_output and not silence.is_over and module.silent == "fails"

    @property
    def reported(self) -> dict[str, int]:
        """Return the elements that some PE has reported, rightly or wrongly, each with the time (ns)."""
        return {element: violation.t_ns for element, violation in self._reported.items()}

    def unfounded(self, truth: Situation) -> list[Violation]:
        """Return a violation for each reported element that is healthy in `truth`.

        There is one exception: some module compares the reported actuator with a sensor, and this sensor is down.
        """
        return [
            violation
            for element, violation in self._reported.items()
            if not _is_down(element, truth)
            and self._compared.get(module_of(element), frozenset()).isdisjoint(truth.down)
        ]


def _compared(spec: Spec) -> dict[str, frozenset[str]]:
    """Return the devices that excuse the report of an element if they are down, as `device:NAME`, by the element.

    Of an actuator, these are the sensors with which some module compares it; of a module with `silent: fails`, its
    device.
    """
    found: dict[str, frozenset[str]] = {}
    for module in spec.modules.values():
        if module.silent == "fails" and module.device is not None:
            found[f"module:{module.name}"] = frozenset((f"device:{module.device}",))
        read = {leaf.variable for mode in module.modes.values() for _, leaf in mode.leaves()}
        devices = {driver.device for variable in read for driver, _ in spec.producers(variable)} - {None}
        by_kind = {kind: [d for d in devices if d and spec.devices[d].kind == kind] for kind in ("actuator", "sensor")}
        for actuator, sensor in product(by_kind["actuator"], by_kind["sensor"]):
            element = f"device:{actuator}"
            found[element] = found.get(element, frozenset()) | {f"device:{sensor}"}
    return found


def _is_down(element: str, truth: Situation) -> bool:
    """Tell whether an element is down; a place (`module:NAME@PE`) is if its module is down on all PEs."""
    return element in truth.down or module_of(element) in truth.down
