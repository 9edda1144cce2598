"""The longest time of a reconfiguration, from the fault until the last PE has reported ACTIVE.

The time is the sum of four parts:

    detect      the time until the manager knows of the fault or of the return:
                - A silent PE is declared down `misses` periods and a quarter after its last state has arrived. The
                  period is the heartbeat period of its uplink. The bound adds the time for which the last state was
                  on its way over the buses
                - A fault that a module reports is detected when its EMCY has arrived
                - A PE that returns sends within a period, and is then held down for ten periods. (Each recent loss
                  doubles the hold-down; the bound assumes no recent loss)
    decide      given by the caller, since a search for a plan has no deadline; only a table look-up has one
    distribute  PREPARE and the slices go out, paced; the last SLICE arrives, and then the last answer
    activate    one command and its last answer for BREAK, if the transition has this step, and the same for GO_ALL. The
                manager does not wait for answers to GO. If a silent PE may still drive a DEMUX, GO_ALL waits for
                T_lease. T_lease counts from the first ALIVE that does not name this PE; the manager sends that ALIVE
                when it declares the PE down

If several PEs fall silent together, each is declared down at its own moment, and the reconfiguration begins anew each
time. The bound counts from the last of these moments, and includes the frames of the epochs that were begun before.

The bound holds on these conditions:

- No other fault occurs during the reconfiguration, apart from PEs that fall silent together.
- Only one module reports a fault.
- No frame is lost or destroyed.
- The nodes need no time to compute. But a node lets frames gather for GATHER_NS before it reads them, unless something
  is urgent for it: the bound adds this time for the message that the manager detects by, and for each command. Answers
  to a command are urgent for the manager. A PE with several buses, which forwards frames, lets none gather.

The manager waits for a PE beyond a radio only if this PE must stop something first. In this case the bound treats the
radio as a cable. If a time has no bound it is None, and `note` says why.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_dg.transition import Transitions
from heronry_manager.bounds.management_times import PACED_BITS, QUIET, Burst, FrameTimes, ManagementTimes
from heronry_manager.core.tables import CompiledConfiguration, Compiler
from heronry_manager.core.topology import reached_by_wire, uplink_bus
from heronry_wire.management import SLICE_BYTES_PER_FRAME, Step
from heronry_wire.protocol_times import GATHER_NS, HOLD_DOWN_PERIODS, silent_ns, t_lease_ns

_NS_PER_S = 1_000_000_000


class FaultClass(Enum):
    """Classes of faults; the value is the text that a user reads."""

    PE_LOST = "PE lost"
    DEVICE_REPORTED = "device reported failed"
    MODULE_REPORTED = "module reported failed"
    BUS_LOST = "bus or gateway lost"
    PARTITION = "link partition"
    PE_RETURNS = "PE returns"


@dataclass(frozen=True, slots=True)
class Case:
    """One fault, or the return of PEs, with the configurations before and after the reconfiguration.

    fault: class of the fault.
    element: name of the element that fails or returns.
    now: the situation after the fault or the return.
    """

    fault: FaultClass
    element: str
    now: Situation
    before: Configuration
    after: Configuration
    silent: tuple[str, ...] = ()  # PEs that the manager no longer hears
    returns: tuple[str, ...] = ()  # PEs that the manager hears again

    @property
    def several(self) -> bool:
        """Tell whether the manager opens several epochs: several PEs are lost or return, each at its own moment."""
        return len(self.silent) > 1 or len(self.returns) > 1


@dataclass(frozen=True, slots=True)
class Bound:
    """Upper bounds on the parts of one reconfiguration, in nanoseconds; None: that part has no bound.

    case: the fault, or the return of PEs, that causes the reconfiguration.
    wait_ns: for how long T_lease of a silent PE delays GO_ALL.
    slice_frames: number of SLICE frames on the manager's bus.
    steps: the steps that ACTIVATE commands, in order.
    note: what the reader must know of this case, or why a part has no bound.
    """

    case: Case
    detect_ns: int | None
    decide_ns: int
    distribute_ns: int | None = None
    activate_ns: int | None = None
    wait_ns: int = 0
    slice_frames: int = 0
    steps: tuple[Step, ...] = ()
    heard_on: str = ""  # the bus on which the manager notices last that a PE is silent, or is back
    note: str = ""
    is_hopeless: bool = False  # no reconfiguration follows: no PE can be commanded, or the fault is not noticed

    @property
    def total_ns(self) -> int | None:
        """The sum of all parts, in nanoseconds; None: one of them has no bound."""
        if self.detect_ns is None or self.distribute_ns is None or self.activate_ns is None:
            return None
        return self.detect_ns + self.decide_ns + self.distribute_ns + self.activate_ns + self.wait_ns


_Times = Mapping[str, FrameTimes]  # of each bus


class CrowdedError(Exception):
    """Management frames alone can fill some buses, so their response times have no bound.

    The message names the buses.
    """


class Bounds:
    """Computes the longest reconfiguration times of one spec."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._frames = ManagementTimes(spec)
        self._paths = self._frames.paths
        self._compiler = Compiler(spec)
        self._transitions = Transitions(spec)
        self._wired = reached_by_wire(spec)

    def bound(self, case: Case, decide_ns: int) -> Bound:
        """Return the bound for one case, if the manager takes `decide_ns` nanoseconds to get a plan."""
        reached = survivors(self._spec, case.now).pe_cpu_millis.keys() & self._paths.keys()
        if not reached:
            return Bound(
                case, None, 0, note="no PE can be commanded; each PE follows without_manager", is_hopeless=True
            )
        try:
            found = self._detected(case, decide_ns)
            if case.after == case.before and not case.returns:
                unchanged = found.note or "the running configuration is still the best"
                return replace(found, distribute_ns=0, activate_ns=0, note=unchanged)
            return self._moved(found, sorted(reached))
        except CrowdedError as error:
            return Bound(case, None, decide_ns, note=str(error))

    def _detected(self, case: Case, decide_ns: int) -> Bound:
        """Begin the bound of a case with the longest time until the manager knows of the fault or a PE's return."""
        times = self._times(Burst(reports=1) if not case.silent and not case.returns else QUIET)
        found = Bound(case, None, decide_ns)
        if case.returns:
            told_ns, last = max((self._speaks_ns(pe) + self._up(pe, times), pe) for pe in case.returns)
            found = replace(found, note="if the PE was lost only once within a minute")
            return replace(found, detect_ns=told_ns, heard_on=uplink_bus(self._spec, last))
        if case.silent:
            told_ns, last = max((self._silence_ns(pe) + self._up(pe, times), pe) for pe in case.silent)
            return replace(found, detect_ns=told_ns, heard_on=uplink_bus(self._spec, last))
        if case.fault is FaultClass.BUS_LOST:
            return replace(found, note="no PE falls silent: the fault is not noticed", is_hopeless=True)
        told_ns = GATHER_NS + max(sum(times[bus].emergency_ns for bus in path) for path in self._paths.values())
        return replace(found, detect_ns=told_ns, note="counted from the report on")

    def _moved(self, found: Bound, reached: Sequence[str]) -> Bound:
        """Add to a bound the times for distributing the slices and for activating the plan.

        reached: the PEs that the manager can command.
        """
        case = found.case
        way = self._transitions.transition(case.before, case.after, case.now)
        steps = tuple(dict.fromkeys((Step.BREAK, *way.steps))) if case.several else way.steps
        awaited = [pe for pe in reached if pe in self._wired]
        burst = self._distributing(case, reached)
        sending, answering = self._times(burst), self._times(self._activating(burst))
        late = self._repeated([*awaited, *way.wait_for], sending)
        if late is not None:
            return replace(found, slice_frames=burst.heads + burst.paced, steps=steps, note=late)
        gap_ns = PACED_BITS * _NS_PER_S // self._spec.buses[self._spec.manager.bus].bitrate
        distribute_ns = max(0, burst.paced - 1) * gap_ns + self._round_trip(awaited, sending)
        waited_for = reached if case.several else way.wait_for
        break_ns = self._round_trip(waited_for, answering) if Step.BREAK in steps else 0
        held_ns = self._held_ns(case, way.hold)
        return replace(
            found,
            distribute_ns=distribute_ns,
            activate_ns=break_ns + self._round_trip(awaited, answering),
            wait_ns=max(0, held_ns - found.decide_ns - distribute_ns - break_ns),
            slice_frames=burst.heads + burst.paced,
            steps=steps,
        )

    def _times(self, burst: Burst) -> _Times:
        buses = {bus for path in self._paths.values() for bus in path}
        times = {bus: self._frames.on(bus, burst) for bus in self._spec.buses if bus in buses}
        crowded = [bus for bus, found in times.items() if found is None]
        if crowded:
            raise CrowdedError(f"management frames alone can fill bus {' and bus '.join(crowded)}")
        return {bus: found for bus, found in times.items() if found is not None}

    def _distributing(self, case: Case, reached: Iterable[str]) -> Burst:
        """Return the frames that may be on the buses while the slices of a case go out.

        If several PEs are lost or return, three epochs may cause frames in this time: the running epoch, an abandoned
        epoch, and the new epoch.

        reached: the PEs whose SLICE frames count.
        """
        epochs = 3 if case.several else 1
        before, after = (self._compiler.configuration(one) for one in (case.before, case.after))
        counts = {pe: self._slice_frames(pe, case, before, after) for pe in reached}
        heads = sum(count == 1 for count in counts.values())
        return Burst(
            heads=heads,
            paced=sum(counts.values()) - heads,
            slices_beyond={
                bus: epochs * sum(count for pe, count in counts.items() if bus in self._paths[pe][1:])
                for bus in self._spec.buses
            },
            broadcasts=epochs,
            answers=epochs,
            reports=0 if case.silent or case.returns else 1,
            silent=frozenset(case.silent),
        )

    def _activating(self, burst: Burst) -> Burst:
        """Return the frames on the buses during a step of activation: one more broadcast and answer than `burst`.

        Of the slices, only those for PEs beyond a radio count, since these PEs may still be receiving slices.

        burst: the frames on the buses while the slices went out.
        """
        first = self._spec.manager.bus
        beyond = burst.slices_beyond
        stragglers = sum(
            count for bus, count in beyond.items() if self._spec.buses[bus].kind == "wireless" and bus != first
        )
        return replace(burst, heads=0, paced=stragglers, broadcasts=burst.broadcasts + 1, answers=burst.answers + 1)

    def _slice_frames(self, pe: str, case: Case, before: CompiledConfiguration, after: CompiledConfiguration) -> int:
        """Return the number of SLICE frames for one PE: one head, and as many bodies as its slice needs.

        - If several PEs are lost or return together, the PE may need its slice in `before` or that in `after`;
          the longer one counts.
        - Otherwise its slice in `after` counts. If the PE has the same slice in `before`, and is not itself
          returning, no bodies are needed.
        """
        node = self._spec.pes[pe].node_id
        length = len(after.slices[node])
        if case.several:
            length = max(length, len(before.slices[node]))
        elif pe not in case.returns and before.slice_digests[node] == after.slice_digests[node]:
            length = 0
        return 1 + -(-length // SLICE_BYTES_PER_FRAME)

    def _speaks_ns(self, pe: str) -> int:
        return (1 + HOLD_DOWN_PERIODS) * self._period_ns(pe)

    def _silence_ns(self, pe: str) -> int:
        bus = self._spec.buses[uplink_bus(self._spec, pe)]
        return silent_ns(bus.heartbeat_ns, bus.misses)

    def _period_ns(self, pe: str) -> int:
        return self._spec.buses[uplink_bus(self._spec, pe)].heartbeat_ns

    def _held_ns(self, case: Case, demuxes: Iterable[str]) -> int:
        """Return the longest T_lease (ns) of the silent PEs that ran a branch or an end of one of these DEMUXes.

        A silent PE may still drive the DEMUX for this time. 0: no silent PE ran such a module.
        """
        rivals = {m for demux in demuxes for group in self._spec.demuxes[demux].exclusives.values() for m in group}
        drove = {running.pe for module, running in case.before.modules.items() if module in rivals}
        return max((t_lease_ns(self._period_ns(pe)) for pe in drove.intersection(case.silent)), default=0)

    def _up(self, pe: str, times: _Times) -> int:
        """Return the longest time from a state of a PE until the manager reads it, in nanoseconds."""
        return GATHER_NS + sum(times[bus].answer_ns for bus in self._paths[pe])

    def _round_trip(self, pes: Iterable[str], times: _Times) -> int:
        """Return the longest time from a command until the last of these PEs has answered, in nanoseconds."""
        ways_ns = [sum(times[bus].command_ns + times[bus].answer_ns for bus in self._paths[pe]) for pe in pes]
        return GATHER_NS + max(ways_ns) if ways_ns else 0

    def _repeated(self, pes: Iterable[str], times: _Times) -> str | None:
        """Say that one of these PEs may answer a command so late that the manager repeats the command.

        None: no PE may answer so late.
        """
        for pe in pes:
            if self._round_trip([pe], times) >= self._period_ns(pe):
                return f"{pe} may answer later than a heartbeat period, so that the command is repeated"
        return None
