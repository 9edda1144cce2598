"""No critical function is dropped without need: the oracle compares what is served with what a plan could serve.

It compares on two occasions.

*When a configuration is activated*, its value at level 1 (critical functions) must be no less than that of the
best plan. The best plan is made for what the manager can know:

- PEs that take no part in the epoch are down.
- An element counts as failed from the moment at which its failure was acknowledged, or declared by the operator,
  until it is cleared. Every element is down that counted as failed at some moment from shortly before PREPARE
  until the activation.
- The phase and the priorities may be those of any such moment.

Two kinds of epochs are not compared:

- An adopted epoch: a manager that adopts the running configuration drops no function by adopting.
- A contingency that PREPARE names by its number, if it is not certain which PEs take part. Every PE that hears
  PREPARE stages the contingency, and only the next ALIVE shows which PEs are available. Nothing is certain in
  three cases:
  1. The manager dies before that ALIVE.
  2. That ALIVE comes so late that a PE may have been lost and have rejoined.
  3. An ALIVE was late within the last heartbeat period. Delayed frames are then sent in the order of their
     identifiers, so their order on the bus proves nothing.

*While no more faults are injected*, a critical function that was heard must not stay silent for longer than
`longest_ns`: one patience, and a second for planning, steps and first values. The oracle makes the best plan for
the worst situation that is possible during the silence. In this situation an element is down if it has an
injected fault, counts as failed, or is a PE that ALIVE does not name. The silence is a violation if this plan
serves every wanted function of the silent function's class and of the classes above. In any situation in which
less is down, the best plan serves these functions, too.

Not verified are silences

- while a bus or a manager has a fault, or any measurement may be wrong;
- in the start-up window of a mastership, as long as no PE runs a module. To a manager that hears no running PE,
  the aircraft looks as if it had just been switched on. So the manager waits for PEs that it has not heard, and
  makes no plan before they are heard or the window ends. The window counts from the first ALIVE of the
  mastership.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

from heronry_dg.model import Spec
from heronry_dg.objective import CRITICAL_CLASSES, score
from heronry_dg.situation import Situation, module_of
from heronry_dg.uplinks import radios
from heronry_manager.core.topology import uplink_bus
from heronry_tools.recording.commanded import Epoch
from heronry_tools.runtime.witness import Outage
from heronry_tools.sim.oracles.flown_spec import all_elements
from heronry_tools.sim.oracles.limits import (
    HOLD_DOWN_PERIODS,
    LEASE_PERIODS,
    PATIENCE_PERIODS,
    RADIO_STEPS,
    START_UP_WINDOW_NS,
)
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.places import Places
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.planning import critical_at_best
from heronry_wire.frame import Malformed
from heronry_wire.gateway_report import PER_MILLE, LinkReport, decode_link
from heronry_wire.management import Control, Emergency, ManagementMessage, Operation

_SECOND_NS = 1_000_000_000
_UNDER_WAY_NS = 5_000_000  # from the manager's decision to the end of its frame
_DOUBTED_NS = 30 * _SECOND_NS  # for which a manager may plan with a share that a gateway has reported


class Injected(NamedTuple):
    """A fault that was injected.

    element: the element that failed; None if that is not clear
    from_ns: when the fault was injected
    to_ns: when the fault ended; None if it did not end
    """

    element: str | None
    from_ns: int
    to_ns: int | None


@dataclass(slots=True)
class _Held:
    """The time in which an element counts as failed; `to_ns` is None while any manager still treats it as failed."""

    element: str
    from_ns: int
    to_ns: int | None = None
    is_certain: bool = True  # every manager treats it as failed


class ServiceCheck(Oracle):
    """Verifies that no critical function is dropped while a plan could serve it."""

    def __init__(self, spec: Spec, missed_ns: Callable[[str], int] = lambda _: 0) -> None:
        """Begin; the order of elements in `spec` gives the indices in CONTROL and EMCY.

        missed_ns: a function that gives, for the name of a PE, the end (ns) of the last silence in which the PE may
        have missed a command; 0 if there was no such silence
        """
        super().__init__()
        self._spec = spec
        self._places = Places(spec)
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}
        self._held: list[_Held] = []
        self._missed_ns = missed_ns
        self._told_by: dict[str, str] = {}  # by element: the PE that has reported it last
        self._available: list[tuple[int, frozenset[str]]] = []  # available PEs, and since when (ns)
        self._alive_ns = 0  # time of the last ALIVE
        self._late_ns = 0  # time of the last ALIVE that came late
        self._beat_ns = spec.buses[spec.manager.bus].heartbeat_ns
        self._called: list[tuple[int, Epoch, str | None]] = []  # contingencies called: time, epoch, phase
        self._phases: list[tuple[int, str | None]] = []
        self._priorities: list[tuple[int, Mapping[str, int]]] = []  # changed ones, from each time on
        self._masterships_ns: list[int] = []  # when each mastership began
        self._idle: list[tuple[int, int]] = []  # times (from, to) in which no PE ran a module
        self._ran_ns = 0  # when a PE last ran a module
        self._lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._hold_down_ns = {
            pe: HOLD_DOWN_PERIODS * spec.buses[uplink_bus(spec, pe)].heartbeat_ns for pe in spec.pes
        }  # of a first loss
        self._radios = {radio.link_id: radio for radio in radios(spec).values()}
        self._usable: list[tuple[int, str, int]] = []  # time, bus, usable share (per mille)
        self.longest_ns = PATIENCE_PERIODS * max(bus.heartbeat_ns for bus in spec.buses.values()) + _SECOND_NS

    def take_over(self, before: "ServiceCheck") -> None:
        """Take over, from the oracle of another spec, what counts as failed, and what ALIVE and the frames showed."""
        there = all_elements(self._spec)
        self._held = [one for one in before._held if one.element in there]
        self._told_by, self._available = before._told_by, before._available
        self._alive_ns, self._late_ns, self._usable = before._alive_ns, before._late_ns, before._usable
        self._masterships_ns, self._idle, self._ran_ns = before._masterships_ns, before._idle, before._ran_ns
        last_ns, phase = before._phases[-1] if before._phases else (0, None)
        self._phases = [(last_ns, phase)] if phase in self._spec.phases else []
        changed = [(t_ns, self._known_ones(priorities)) for t_ns, priorities in before._priorities[-1:]]
        self._priorities = list(changed)

    def _known_ones(self, priorities: Mapping[str, int]) -> Mapping[str, int]:
        return {function: one for function, one in priorities.items() if function in self._spec.functions}

    def emergency(self, _sent: Sent, pe: str, message: Emergency | Malformed) -> None:
        """Record which PE reports a fault or withdraws its report."""
        if isinstance(message, Emergency):
            element = self._places.reported(pe, message)
            if element is not None:
                self._told_by |= dict.fromkeys((element, module_of(element)), pe)

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Record, when a manager acknowledges a report of a fault, that managers now treat the element as failed.

        Commands other than ACKNOWLEDGE have no effect.
        """
        if not isinstance(message, Control):
            return
        if message.operation is Operation.ACKNOWLEDGE:
            element = self._places.acknowledged(message.node, message.a, message.b)
            if element is not None:
                self.failed(t_ns, element)

    def failed(self, t_ns: int, element: str) -> None:
        """Record that every manager treats an element as failed from now on, if this is not recorded yet."""
        known = [one for one in self._held if one.element == element and one.to_ns is None]
        self._held += [] if known else [_Held(element, t_ns)]
        for one in known:
            one.is_certain = True

    def cleared(self, t_ns: int, element: str, _truth: Situation, *, everywhere: bool) -> None:
        """Record that an element was cleared.

        everywhere: False if another manager may still treat the element as failed.
        """
        self._places.cleared(element)
        for one in self._held:
            if element in (one.element, module_of(one.element)) and one.to_ns is None:
                one.to_ns, one.is_certain = t_ns if everywhere else None, False

    @property
    def held(self) -> set[str]:
        """Return the elements that every manager now treats as failed."""
        return {one.element for one in self._held if one.is_certain}

    def _held_at(self, from_ns: int, to_ns: int) -> set[str]:
        """Return the elements that counted as failed at any moment from `from_ns` to `to_ns`."""
        return {h.element for h in self._held if h.from_ns <= to_ns and (h.to_ns is None or from_ns < h.to_ns)}

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """Record the available PEs, and verify the contingencies that were activated since the last ALIVE.

        A contingency that was activated more than T_lease before this ALIVE is not verified.
        """
        self._late_ns = t_ns if self._is_late(t_ns) else self._late_ns
        self._alive_ns = t_ns
        _, before = self._available[-1] if self._available else (0, frozenset[str]())
        if pes != before:
            self._available.append((t_ns, pes))
        for called_ns, epoch, phase in self._called:
            if t_ns - called_ns <= self._lease_ns:
                past_ns = t_ns - called_ns + _UNDER_WAY_NS
                stayed = {pe for pe, hold_down_ns in self._hold_down_ns.items() if past_ns < hold_down_ns}
                present = before & pes & stayed & self._participants(epoch)
                self.violations += self._compare(called_ns, epoch, phase, present)
        self._called.clear()

    def began(self, t_ns: int) -> None:
        """Record that a mastership begins, and for which failed elements the manager may lack the report.

        It may lack the report of an element if a silence of the PE that reported the element (`missed_ns`) ended after
        the element began to count as failed. Such an element no longer counts as failed for every manager (`held`).
        """
        for one in self._held:
            if self._missed_ns(self._told_by.get(one.element, "")) >= one.from_ns:
                one.is_certain = False
        self._masterships_ns.append(t_ns)
        self._called.clear()

    def ran(self, t_ns: int) -> None:
        """Record that a PE runs a module now.

        If no PE has run a module for longer than T_lease until now, record this interval, too. In the part of the
        interval that lies in a start-up window, silences of functions are not verified.
        """
        if t_ns - self._ran_ns > self._lease_ns:
            self._idle.append((self._ran_ns, t_ns))
        self._ran_ns = t_ns

    def measured(self, sent: Sent) -> None:
        """Record that a gateway reports only a part of its radio's bandwidth as usable; ignore other reports."""
        radio, report = self._radios.get(sent.frame.can_id), decode_link(sent.frame.data)
        if radio is not None and isinstance(report, LinkReport) and report.usable < PER_MILLE:
            self._usable.append((sent.end_ns, f"bus:{radio.bus}", report.usable))

    def _limits(self, t_ns: int) -> dict[str, Fraction]:
        """Return, by radio (`bus:NAME`), the smallest share of its bandwidth with which a manager may plan at `t_ns`.

        A radio is left out if no gateway has reported less than its full bandwidth within `_DOUBTED_NS`.
        """
        limits: dict[str, Fraction] = {}
        for at_ns, bus, usable in self._usable:
            if t_ns - _DOUBTED_NS <= at_ns <= t_ns:
                step = Fraction(next(step for step in RADIO_STEPS if step <= usable), PER_MILLE)
                limits[bus] = min(step, limits.get(bus, step))
        return limits

    def entered(self, t_ns: int, phase: str | None) -> None:
        """Record that a mission phase has begun."""
        self._phases.append((t_ns, phase))

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """Verify that an epoch serves critical functions no worse than the best plan.

        An adopted epoch is not verified. A contingency is verified at the next ALIVE, which shows which PEs take part
        in the epoch. But it is not verified if an ALIVE is overdue now, or was late within the last heartbeat period.
        """
        if epoch.is_adopted:
            return
        phase = self._phases[-1][1] if self._phases else self._spec.initial_phase()
        if epoch.contingency:
            if t_ns - self._late_ns > self._beat_ns and not self._is_late(t_ns):
                self._called.append((t_ns, epoch, phase))  # the next ALIVE shows which PEs take part
        else:
            self.violations += self._compare(t_ns, epoch, phase, self._participants(epoch))

    def _is_late(self, t_ns: int) -> bool:
        """Tell whether the next ALIVE is overdue."""
        return t_ns - self._alive_ns > self._beat_ns * 5 // 4 + _UNDER_WAY_NS

    def _participants(self, epoch: Epoch) -> set[str]:
        return {pe for pe, node in self._node_of.items() if epoch.has(node)}

    def _compare(self, t_ns: int, epoch: Epoch, phase: str | None, present: Iterable[str]) -> Iterator[Violation]:
        """Yield a violation if an epoch serves critical functions worse than the best plan for the PEs in `present`.

        There may be several situations for which the epoch may have been planned. Then there is a violation only if
        the epoch serves worse than the best plan in each of them.

        phase: the phase at the activation, for which the epoch may have been planned
        present: the PEs that take part in the epoch
        """
        if epoch.configuration is None:
            return
        absent = {f"pe:{pe}" for pe in self._node_of.keys() - present}
        planned_ns = min(epoch.prepared_ns, t_ns) - _UNDER_WAY_NS
        failed = self._held_at(planned_ns, t_ns)
        limits = self._limits(t_ns)
        stories = [
            self._falls_short(epoch, Situation(frozenset(absent | failed), limits, now.phase, now.priorities))
            for now in self._in_force(planned_ns, t_ns, phase)
        ]
        if None not in stories:
            yield Violation(t_ns, "service", f"{stories[0]} without {sorted(absent)}")

    def _falls_short(self, epoch: Epoch, now: Situation) -> str | None:
        """Return a sentence if an epoch serves less at level 1 than the best plan for `now`, otherwise None."""
        assert epoch.configuration is not None
        served = score(self._spec, now, epoch.configuration, None).critical
        possible = critical_at_best(self._spec, now)
        if served >= possible:
            return None
        return f"epoch {epoch.number} serves {served} by criticality, but a plan serves {possible}"

    def in_force(self, prepared_ns: int, to_ns: int) -> list[Situation]:
        """Return the situations, one per phase and priorities, on which a plan prepared at `prepared_ns` may rest.

        Nothing is down in them: the method is for flights in which only managers fail.
        """
        return self._in_force(prepared_ns - _UNDER_WAY_NS, to_ns)

    def _in_force(self, from_ns: int, to_ns: int, *phases: str | None) -> list[Situation]:
        known = dict.fromkeys((*phases, *self._phases_in(from_ns, to_ns)))
        return [Situation(phase=one, priorities=p) for one in known for p in self._priorities_in(from_ns, to_ns)]

    def _phases_in(self, from_ns: int, to_ns: int) -> list[str | None]:
        """Return the phases in effect at any moment from `from_ns` to `to_ns`; None: the spec has no phases."""
        spans = pairwise([(0, self._spec.initial_phase()), *self._phases, (to_ns + 1, None)])
        return [name for (since_ns, name), (over_ns, _) in spans if since_ns <= to_ns and from_ns < over_ns]

    def prioritized(self, t_ns: int, priorities: Mapping[str, int]) -> None:
        """Record that the manager announces changed priorities, by function."""
        self._priorities.append((t_ns, priorities))

    def _priorities_in(self, from_ns: int, to_ns: int) -> list[Mapping[str, int]]:
        """Return the priorities that were in effect at any moment from `from_ns` to `to_ns`."""
        spans = pairwise([(0, {}), *self._priorities, (to_ns + 1, {})])
        return [found for (since_ns, found), (over_ns, _) in spans if since_ns <= to_ns and from_ns < over_ns]

    def silences(self, outages: Iterable[Outage], injected: Sequence[Injected], end_ns: int) -> list[Violation]:
        """Return a violation for each critical function that was silent too long although a plan could have served it.

        injected: the faults that were injected into the aircraft. end_ns: the end of the flight.
        """
        self.ran(end_ns)
        return [found for outage in outages if (found := self._silence(outage, injected, end_ns)) is not None]

    def _silence(self, outage: Outage, injected: Sequence[Injected], end_ns: int) -> Violation | None:
        function = self._spec.functions[outage.function]
        moments = {moment for one in injected for moment in (one.from_ns, one.to_ns) if moment is not None}
        moments |= {t_ns for t_ns, _ in (*self._available, *self._phases, *self._priorities)}
        moments |= {moment for one in self._held for moment in (one.from_ns, one.to_ns) if moment is not None}
        moments |= {moment for time in self._starts() for moment in time}
        to_ns = end_ns if outage.to_ns is None else outage.to_ns
        within = sorted({outage.from_ns, to_ns, *(t for t in moments if outage.from_ns < t < to_ns)})
        for begin_ns, over_ns in pairwise(within):
            if over_ns - begin_ns <= self.longest_ns:
                continue
            now = self._situation(begin_ns, over_ns, injected)
            if now is not None and self._could_serve(outage.function, now):
                quiet_ms = (over_ns - begin_ns) / 1e6
                story = f"{function.name} was silent for {quiet_ms:.0f} ms without a new fault, but a plan without"
                return Violation(begin_ns, "service", f"{story} {sorted(now.down)} serves it")
        return None

    def _situation(self, begin_ns: int, over_ns: int, injected: Sequence[Injected]) -> Situation | None:
        """Return the worst situation that is possible from `begin_ns` to `over_ns`.

        Between these times no fault begins or ends, and the available PEs, the phase, the priorities and the
        elements that count as failed stay the same.

        None: the situation is not known, because a fault of unknown effect is present, or because the time is
        in a start-up window in which no PE runs a module.
        """
        hit = [s for s in injected if s.from_ns <= begin_ns and (s.to_ns is None or s.to_ns >= over_ns)]
        starts = any(from_ns <= begin_ns and over_ns <= to_ns for from_ns, to_ns in self._starts())
        if starts or any(one.element is None for one in hit):
            return None
        elements = {one.element for one in hit if one.element is not None}
        down = elements | self._held_at(begin_ns, begin_ns)
        available = next((pes for t_ns, pes in reversed(self._available) if t_ns <= begin_ns), frozenset[str]())
        down |= {f"pe:{pe}" for pe in self._spec.pes if pe not in available}
        phase = next((name for t_ns, name in reversed(self._phases) if t_ns <= begin_ns), self._spec.initial_phase())
        return Situation(frozenset(down), self._limits(over_ns), phase, self._priorities_in(begin_ns, begin_ns)[-1])

    def _starts(self) -> Iterator[tuple[int, int]]:
        """Yield (from, to) in ns of each span in which a start-up window was open and no PE ran a module."""
        for began_ns in self._masterships_ns:
            for from_ns, to_ns in self._idle:
                first_ns, last_ns = max(began_ns, from_ns), min(began_ns + START_UP_WINDOW_NS, to_ns)
                if first_ns < last_ns:
                    yield first_ns, last_ns

    def _could_serve(self, name: str, now: Situation) -> bool:
        """Tell whether the best plan serves every wanted function of this function's class and of the classes above.

        Returns False if this function is not critical, or not wanted.
        """
        functions = self._spec.functions.values()
        criticality = self._spec.functions[name].criticality_in(now.phase)
        if criticality not in CRITICAL_CLASSES or not now.priority_of(self._spec.functions[name]):
            return False
        last = CRITICAL_CLASSES.index(criticality)
        possible = critical_at_best(self._spec, now)
        return all(
            possible[i] == sum(now.priority_of(f) for f in functions if f.criticality_in(now.phase) == one)
            for i, one in enumerate(CRITICAL_CLASSES[: last + 1])
        )
