"""`Checks`: all oracles of one flight (`registry`), with their inputs and their violations.

Frames come in by `see`. The code that causes another event (a step of a module, a fault, an order) reports the event by
the method for this event.

In a flight with a reload the oracles are at first those of the old spec. With the first step of an epoch of the other
spec (`frames`), oracles of that spec take their place (`known`); that may happen again, in either direction. A step of
a module that the present spec does not have concerns only the oracles that know both specs.
"""

from collections.abc import Collection, Iterable, Sequence

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.oracles.end_state import Seen, end_state
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.frames import FrameWatch
from heronry_tools.sim.oracles.journal import Read
from heronry_tools.sim.oracles.known import Given, Known
from heronry_tools.sim.oracles.oracle import Oracle, listeners
from heronry_tools.sim.oracles.registry import oracles
from heronry_tools.sim.oracles.service import Injected
from heronry_tools.sim.oracles.silence import stopped_by_silence
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Clash, Sent
from heronry_tools.sim.world.planning_seen import PlanningSeen
from heronry_tools.sim.world.replicated_port import Copy
from heronry_tools.sim.world.steps_seen import Driven, Moved, StateSeen, Withheld
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.authentication import Key
from heronry_wire.part_transfer import Received
from heronry_wire.pe_table import PeTable


class Checks:
    """The oracles of one flight, and the methods by which the simulator reports events to them."""

    def __init__(
        self,
        spec: Spec,
        tables: Collection[PeTable] = (),
        key: Key | None = None,
        read_journal: Read = lambda _: None,
        *,
        brings_tables: bool = False,
        bundles: Collection[bytes] = (),
        other: FlownSpec | None = None,
    ) -> None:
        """Create the oracles for a flight of this spec.

        tables: the tables of the PEs, by which slices and contingencies are recognized
        key: the key of managers and PEs; None without authentication
        read_journal: returns the bytes of the journal of the manager at a station
        brings_tables: whether the managers bring tables to nodes without one
        bundles: code that the managers bring
        other: the spec to which the aircraft may change in flight; None: it does not
        """
        flown = FlownSpec(spec, {table.name: table for table in tables})
        given = Given(key, read_journal, brings_tables=brings_tables, bundles=bundles)
        self._every: dict[int, Oracle] = {}  # all oracles of the flight, also those of the spec before
        self._past: list[tuple[Known, int]] = []  # what was known by a spec, and when the next one took over (ns)
        self._rests = False
        self._inspections: list[Violation] = []
        self._use(Known(flown, given, other))

    def _use(self, known: Known, before: FrameWatch | None = None) -> None:
        """Let the oracles of one spec observe the flight from now on."""
        self._known, self._spec = known, known.spec
        self._oracles = oracles(known)
        self._every |= {id(oracle): oracle for oracle in self._oracles}
        self._frames = FrameWatch(known, self._oracles, self._changes, before)
        self._of_frames = listeners(self._oracles, "seen")
        self._of_copies = listeners(self._oracles, "copied")
        self._of_channels = listeners(self._oracles, "carried")
        self._of_driving = listeners(self._oracles, "driven")
        self._of_looks = listeners(self._oracles, "looked")
        self._of_moves = listeners(self._oracles, "moved")
        self._of_withheld = listeners(self._oracles, "withheld")
        self._of_states = listeners(self._oracles, "state_seen")
        self._of_planning = listeners(self._oracles, "planning")
        if self._rests:
            self.rest()

    def _changes(self, t_ns: int, epoch: int) -> FrameWatch:
        """Let the oracles of the other spec take over, since the PEs change to it by this epoch."""
        before = self._known
        self._past.append((before, t_ns))
        self._use(before.changed(epoch), self._frames)
        if before.either is not None:
            before.either.changes(t_ns, self._spec.digest)
        return self._frames

    def rest(self) -> None:
        """Stop reporting steps, movements and frames of single channels to the oracles: this run is not verified.

        From now on the caller must not call `see`. What the oracles record after this call has no meaning.
        """
        self._rests = True
        self._of_copies = self._of_channels = self._of_driving = self._of_looks = self._of_moves = ()
        self._of_withheld = self._of_states = ()

    # What is seen

    def see(self, sent: Sent) -> None:
        """Give the oracles a frame of any bus."""
        self._frames.see(sent)
        for oracle in self._of_frames:
            oracle.seen(sent)

    def copied(self, copy: Copy) -> None:
        """Report to the oracles that a channel of a replicated bus has delivered a copy of a frame to a node."""
        for oracle in self._of_copies:
            oracle.copied(copy)

    def carried(self, channel: int, sent: Sent) -> None:
        """Report to the oracles that a channel of a replicated bus, 0 or 1, has carried a frame."""
        for oracle in self._of_channels:
            oracle.carried(channel, sent)

    def moved(self, moved: Moved) -> None:
        """Report to the oracles that a PE has passed the command of a module to the module's device."""
        for oracle in self._of_moves if moved.module in self._spec.modules else (self._known.exclusion,):
            oracle.moved(moved)

    def driven(self, driven: Driven) -> None:
        """Report a step of a module to the oracles, with the inputs of this step.

        The module drives an actuator, or is a branch of a DEMUX.
        """
        for oracle in self._of_driving if driven.module in self._spec.modules else (self._known.exclusion,):
            oracle.driven(driven)

    def looked(self, stepped: Driven) -> None:
        """Report a step of a module to the oracles, with the inputs of this step.

        The module drives no actuator, and is no branch of a DEMUX.
        """
        for oracle in self._of_looks if stepped.module in self._spec.modules else ():
            oracle.looked(stepped)

    def withheld(self, step: Withheld) -> None:
        """Report to the oracles a step of a module that leaves out an output of its mode."""
        for oracle in self._of_withheld if step.module in self._spec.modules else ():
            oracle.withheld(step)

    def state_seen(self, seen: StateSeen) -> None:
        """Report to the oracles that a module has saved its state, or has started from a state."""
        for oracle in self._of_states if seen.module in self._spec.modules else ():
            oracle.state_seen(seen)

    def planning(self, seen: PlanningSeen) -> None:
        """Report to the oracles that a manager has requested a plan, or is given the answer to a request."""
        for oracle in self._of_planning:
            oracle.planning(seen)

    def stepped(self, t_ns: int, pe: str, module: str) -> None:
        """Report to the oracles, in a flight with a reload, every step of a module."""
        if self._known.either is not None:
            self._known.either.stepped(t_ns, pe, module)

    # What is done to the aircraft

    def flies(self, t_ns: int, pe: str, table: PeTable) -> None:
        """Report to the oracles with which table a PE starts, or goes on in flight."""
        if self._known.either is not None:
            self._known.either.flies(t_ns, pe, table)

    def manager_flies(self, t_ns: int, station: str, spec: Spec) -> None:
        """Report to the oracles the spec of the manager at a station, when it starts or has changed in flight."""
        if self._known.either is not None:
            self._known.either.manager_flies(t_ns, station, spec.digest)

    def pe_died(self, pe: str) -> None:
        """Report to the oracles that a PE has died."""
        if self._known.either is not None:
            self._known.either.gone(pe)

    def reload_ordered(self) -> None:
        """Report to the oracles that a manager has accepted the order to change to the other spec."""
        if self._known.either is not None:
            self._known.either.reload_ordered()
        if self._known.tables is not None:
            self._known.tables.reload_ordered()

    def reload_over(self, *, is_given_up: bool) -> None:
        """Report to the oracles that a manager says that the change is given up, or that it is done."""
        if self._known.either is not None:
            self._known.either.reload_over(is_given_up=is_given_up)
        if self._known.tables is not None:
            self._known.tables.reload_ordered(is_over=True)

    def bus_split(self, t_ns: int, bus: str, is_split: bool) -> None:
        """Report to the oracles that a bus has broken in the middle (`is_split`), or was repaired."""
        self._known.solitude.split(t_ns, bus)
        for oracle in self._oracles:
            oracle.bus_split(t_ns, bus, is_split)

    def silenced(self, t_ns: int, module: str, output: int) -> None:
        """Report to the oracles that a module ceases to give an output, counted from 1 in its mode; 0: all of them."""
        for oracle in self._oracles if module.partition("@")[0] in self._spec.modules else ():
            oracle.silenced(t_ns, module, output)

    def unsilenced(self, module: str) -> None:
        """Report to the oracles that a module gives all its outputs again."""
        for oracle in self._oracles:
            oracle.unsilenced(module)

    def altered(self) -> None:
        """Report to the oracles that from now on data frames are altered in a way that their CRC does not detect."""
        for oracle in self._oracles:
            oracle.altered()

    def manager_copied(self, station: str, twin: str) -> None:
        """Report to the oracles that a second manager is about to start, at station `twin`.

        It has a copy of the journal of the manager at `station`.
        """
        for oracle in self._oracles:
            oracle.manager_copied(station, twin)

    def manager_died(self, t_ns: int, station: str) -> None:
        """Report to the oracles that the manager at this station has died; its journal remains on its disk."""
        for oracle in self._oracles:
            oracle.manager_died(t_ns, station)

    def may_count_again(self) -> None:
        """Report to the oracles that from now on a manager may reuse command numbers of its present term."""
        for oracle in self._oracles:
            oracle.may_count_again()

    def may_forget_phase(self) -> None:
        """Allow a manager, from now on, to begin its mastership with a phase that has already ended."""
        for oracle in self._oracles:
            oracle.may_forget_phase()

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """Report to the oracles that a manager has accepted, in this term, the operator's order for a phase."""
        for oracle in self._oracles:
            oracle.ordered(t_ns, phase, term)

    def set_priority(self, t_ns: int, function: str, priority: int | None) -> None:
        """Report to the oracles that a manager has accepted the operator's order for a priority.

        A `priority` of None is the priority of the spec.
        """
        for oracle in self._oracles:
            oracle.set_priority(t_ns, function, priority)

    def manager_jumped(self, t_ns: int, ahead_ns: int) -> None:
        """Report to the oracles that the clock of a manager has jumped ahead."""
        for oracle in self._oracles:
            oracle.manager_jumped(t_ns, ahead_ns)

    def script_ordered(self, t_ns: int, term: int | None) -> None:
        """Report to the oracles that a manager has accepted a script of the operator.

        term: the term of this manager; None: the script was released.
        """
        for oracle in self._oracles:
            oracle.script_ordered(t_ns, term)

    def declared(self, t_ns: int, element: str) -> None:
        """Report to the oracles that a manager now plans without an element that the operator has declared failed."""
        for oracle in self._oracles:
            oracle.failed(t_ns, element)

    def cleared(self, t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:
        """Report to the oracles that the operator has cleared an element.

        truth: the real situation just before the clearing. everywhere: False if only one of two managers knows of the
        order.
        """
        for oracle in self._oracles:
            oracle.cleared(t_ns, element, truth, everywhere=everywhere)

    def took_table(self, t_ns: int, pe: str, table: PeTable) -> None:
        """Report to the oracles that a node that waited for the table of a PE has taken this one."""
        if self._known.tables is not None:
            self._known.tables.took(t_ns, pe, table)

    def table_came(self, t_ns: int, pe: str, received: Received) -> None:
        """Report to the oracles how far the table of a node that waits for it has come; nothing: the node starts."""
        if self._known.tables is not None:
            self._known.tables.came(t_ns, pe, received)

    def lacks_code(self, t_ns: int, pe: str, module: str) -> None:
        """Report to the oracles that a PE lacks the code of a module."""
        if self._known.code is not None:
            self._known.code.lacks(t_ns, pe, module)

    def code_came(self, t_ns: int, pe: str, content: bytes) -> None:
        """Report to the oracles the bundle from which a PE runs now."""
        if self._known.code is not None:
            self._known.code.came(t_ns, pe, content)

    def code_brought(self, t_ns: int, pe: str, content: bytes | None) -> bool:
        """Report to the oracles that a manager says that code has come, and what the disk of the PE has in use.

        Returns whether the code has come.
        """
        return self._known.code is not None and self._known.code.brought(t_ns, pe, content)

    def wrong(self, t_ns: int, story: str) -> None:
        """Record a violation: a diagnostic client has found that a PE does not behave as a CANopen node must."""
        self._inspections.append(Violation(t_ns, "inspection", story))

    # What is known

    @property
    def spec(self) -> Spec:
        """Return the spec of the epoch that was activated last; before the first one, that of the flight's begin."""
        return self._spec

    @property
    def witness(self) -> Witness:
        """Return the record of the functions whose outputs were heard on the managers' bus."""
        return self._known.witness

    @property
    def reported(self) -> dict[str, int]:
        """Return the elements that some PE has reported as failed, each with the time (ns) of the first report.

        The reports of an element that was down are dropped when the element is cleared.
        """
        return self._known.blame.reported

    @property
    def phase(self) -> str | None:
        """Return the mission phase that the operator or a PE requested last; at first the initial phase of the spec."""
        return self._known.phases.current

    @property
    def priorities(self) -> dict[str, int]:
        """Return the priorities in force, by function, where they differ from those of the spec."""
        return dict(self._known.priorities.current)

    @property
    def epoch(self) -> int | None:
        """Return the epoch that was activated last; None before the first one."""
        current = self._known.commanded.current
        return None if current is None else current.number

    @property
    def settling_ns(self) -> int:
        """Return the longest time for which a critical function may be silent after a fault."""
        return self._known.service.longest_ns

    def planned(self, pe: str) -> dict[str, str]:
        """Return the modules, with their modes, that a PE runs in the epoch activated last."""
        epoch = self._known.commanded.current
        configuration = None if epoch is None else epoch.configuration
        running = {} if configuration is None else configuration.modules
        return {name: one.mode for name, one in running.items() if one.pe == pe}

    def liveness_bound_ns(self) -> int:
        """Return the longest time from now until the aircraft must have converged, if no further fault is injected."""
        return self._known.losses.bound_ns()

    # What was found

    def broken(self, truth: Situation, clashes: list[Clash]) -> list[Violation]:
        """Return the violations so far of the rules that must hold during the whole flight.

        clashes: arbitrations in which two stations sent under one identifier.
        """
        stories = [
            Violation(c.t_ns, "clash", f"{' and '.join(c.stations)} both wanted to send {c.can_id} on {c.bus}")
            for c in clashes
            if not any(station.startswith(STRANGER) for station in c.stations)
        ]
        found = [violation for oracle in self._every.values() for violation in oracle.violations]
        return sorted([*found, *self._known.blame.unfounded(truth), *stories, *self._inspections])

    def unsettled(self, truth: Situation, now_ns: int) -> list[Violation]:
        """Return a violation for each rule for the end of a flight (`end_state`) that does not hold now."""
        known = self._known
        seen = Seen(
            known.epochs.last,
            known.witness,
            known.commanded.current,
            known.phases.named,
            known.service.held,
            is_script_held=known.scripts.is_held(now_ns),
        )
        mixed = () if known.either is None else known.either.unsettled(now_ns)
        return [*end_state(self._spec, truth, now_ns, seen), *mixed]

    def is_well(self, t_ns: int) -> None:
        """Let the oracle `planned_load` count data frames from now on.

        To be called in the middle of the quiet time in which the aircraft converges (`Simulation.settle`).
        """
        self._known.planned_load.begin(t_ns)

    def unplanned(self, t_ns: int, truth: Situation) -> list[Violation]:
        """Return a violation for each datum sent more often than the activated plan says, since `is_well`."""
        return self._known.planned_load.unplanned(t_ns, self._known.commanded.current, truth)

    def denials(self, faults: Collection[Fault], span_ns: range, *, has_others: bool) -> list[Violation]:
        """Return a violation for each service that forged frames alone have denied in a flight with a key.

        The list is empty without a key, without a fault, and if any fault was something other than forged
        frames that take less than a tenth of a bus (`availability`).

        faults: all faults that were injected
        has_others: whether the aircraft got orders, or anything else besides `faults`; if so, nothing is verified
        span_ns: begin and end of the time that is verified
        """
        check = self._known.availability
        return [] if check is None or has_others else check.denials(faults, self._known.witness, span_ns)

    def untold(self, faults: Collection[Fault], *, has_others: bool) -> list[Violation]:
        """Return a violation for each silence of a module that no PE told in time; arguments as in `denials`."""
        only_silent = all(fault.kind == "silent" for fault in faults)
        return self._known.stale.untold() if only_silent and not has_others else []

    def stopped(self, targets: Iterable[str], span_ns: range) -> list[Violation]:
        """Return a violation for each function that fell silent without a reason that `silence` permits.

        targets: what faults were injected into; if one is not a manager, nothing is verified.
        """
        begin_ns = max([span_ns.start, *(until_ns for _, until_ns in self._past)])
        return stopped_by_silence(
            self._spec, targets, self.witness, range(begin_ns, span_ns.stop), self._known.left_out
        )

    def silences(self, injected: Sequence[Injected], end_ns: int) -> list[Violation]:
        """Return a violation for each critical function that was silent although a plan could have served it.

        injected: the faults that were injected into the aircraft. end_ns: the end of the flight.
        """
        spans = [*self._past, (self._known, end_ns)]
        return [
            violation
            for known, to_ns in spans
            for violation in known.service.silences(known.witness.outages(to_ns), injected, to_ns)
        ]

    def missed_steps(self, faults: Iterable[Fault]) -> list[Violation]:
        """Return a violation for each step that a module has missed since a reload was ordered (`either_spec`).

        faults: all faults that were injected.
        """
        either = self._known.either
        return [] if either is None else either.missed_steps({fault.kind for fault in faults})
