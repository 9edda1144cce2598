"""Everything that was heard on the managers' bus, with times. Expectations are evaluated from nothing else.

Outputs come from the witness (echoes of actuators, frames of outputs). Data, states of PEs, EMCYs and LEASEs come from
their frames. Events of a manager are not used. All observations are kept, and evaluated when the flight is over. So a
flight in the simulator and a flight of real processes are evaluated alike.
"""

from dataclasses import dataclass, field

from heronry_dg.model import Spec
from heronry_dg.situation import places
from heronry_dg.traffic import identifiers
from heronry_tools.runtime.witness import Output, Witness
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import MANAGER_NODES, Command, emcy_id, management_id, state_id
from heronry_wire.management import ElementKind, FaultCode, decode_emergency
from heronry_wire.state_frames import StatePage0, decode_state

_REPORTS_NO_FAULT = (
    FaultCode.RESET,
    FaultCode.PHASE_REQUEST,
    FaultCode.PRIORITY_REQUEST,
    FaultCode.DISAGREEMENT,
    FaultCode.UNKNOWN_ELEMENT,
    FaultCode.UNKNOWN_OUTPUT,
    FaultCode.UNKNOWN_INPUT,
    FaultCode.STALE,
    FaultCode.MODULE_RESTARTED,
    FaultCode.CHANNEL_BACK,
    FaultCode.STATE_RESTORED,
    FaultCode.STATE_LACKING,
)


@dataclass(frozen=True, slots=True)
class Heard:
    """A state frame (page 0) of a PE."""

    t_ns: int
    pe: str
    page: StatePage0


@dataclass(slots=True)
class Observations:
    """Everything that was heard on the managers' bus, in order of time."""

    spec: Spec
    outputs: list[Output] = field(default_factory=list)
    data: list[tuple[int, str]] = field(default_factory=list)  # time (ns), variable
    states: list[Heard] = field(default_factory=list)
    reports: list[tuple[int, str]] = field(default_factory=list)  # time (ns), element
    leases: list[int] = field(default_factory=list)
    witness: Witness = field(init=False)
    _variables: dict[int, str] = field(init=False)
    _pe_of_state: dict[int, str] = field(init=False)
    _pe_of_emergency: dict[int, str] = field(init=False)
    _names: dict[ElementKind, tuple[str, ...]] = field(init=False)
    _places: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        spec = self.spec
        self.witness = Witness(spec)
        self._variables = {number: variable for (_, variable), number in identifiers(spec).items()}
        self._pe_of_state = {state_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._pe_of_emergency = {emcy_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self._places = frozenset(place for module in spec.modules for place in places(spec, module))
        self._names = {
            ElementKind.PE: tuple(spec.pes),
            ElementKind.DEVICE: tuple(spec.devices),
            ElementKind.MODULE: tuple(spec.modules),
            ElementKind.BUS: tuple(spec.buses),
        }

    def see(self, t_ns: int, frame: Frame) -> None:
        """Record what a frame on the managers' bus shows; `t_ns` is the end of the frame."""
        if frame.extended or frame.remote:
            return
        variable = self._variables.get(frame.can_id)
        if variable is not None:
            self.data.append((t_ns, variable))
            return
        output = self.witness.see(t_ns, frame)
        if output is not None:
            self.outputs.append(output)
        elif frame.can_id in self._pe_of_state:
            page = decode_state(frame.data)
            if isinstance(page, StatePage0):
                self.states.append(Heard(t_ns, self._pe_of_state[frame.can_id], page))
        elif frame.can_id in self._pe_of_emergency:
            self._report(t_ns, frame)
        elif frame.can_id in _LEASES:
            self.leases.append(t_ns)

    def _report(self, t_ns: int, frame: Frame) -> None:
        emergency = decode_emergency(frame.data)
        if isinstance(emergency, Malformed) or emergency.code in _REPORTS_NO_FAULT:
            return
        if emergency.kind is ElementKind.CHANNEL:
            buses = self.spec.pes[self._pe_of_emergency[frame.can_id]].buses
            self.reports += [(t_ns, f"channel:{bus}.{emergency.detail}") for bus in buses[emergency.index :][:1]]
            return
        names = self._names.get(emergency.kind, ())
        if emergency.index < len(names):
            element = f"{emergency.kind.name.lower()}:{names[emergency.index]}"
            place = f"{element}@{self._pe_of_emergency[frame.can_id]}"
            by_itself = emergency.code is not FaultCode.REPORTED and place in self._places
            self.reports.append((t_ns, place if by_itself else element))


_LEASES = frozenset(management_id(node, Command.LEASE) for node in MANAGER_NODES)
