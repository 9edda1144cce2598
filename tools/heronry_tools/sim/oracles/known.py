"""Facts that several oracles of one flight use: commanded epochs, available PEs, the active manager, the phase.

All facts are derived from the frames, and from the orders and faults of the flight; none is read from a core. Some
facts are derived by oracles. This file creates these oracles, and the list of all oracles (`registry`) has them, too.

*Two specs.* In a flight with a reload the aircraft may change to another spec. Then the oracles of the other spec take
over (`changed`). What is about nodes and epochs, whatever the spec, goes on; what is about functions, phases and
elements is taken over by their names; all else begins anew.
"""

from collections.abc import Collection
from dataclasses import dataclass

from heronry_tools.recording.commanded import Commanded
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.oracles.authenticity import AuthenticityCheck
from heronry_tools.sim.oracles.availability import AvailabilityCheck
from heronry_tools.sim.oracles.blame import BlameCheck
from heronry_tools.sim.oracles.channels import ChannelCheck
from heronry_tools.sim.oracles.code import CodeCheck
from heronry_tools.sim.oracles.either_spec import EitherSpecCheck
from heronry_tools.sim.oracles.epochs import EpochCheck
from heronry_tools.sim.oracles.exclusion import ExclusionCheck
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.freshness import FreshnessCheck
from heronry_tools.sim.oracles.journal import Read
from heronry_tools.sim.oracles.liveness import Losses
from heronry_tools.sim.oracles.phase import PhaseCheck
from heronry_tools.sim.oracles.planned_load import PlannedLoadCheck
from heronry_tools.sim.oracles.priorities import PriorityCheck
from heronry_tools.sim.oracles.proven_states import ProvenStates
from heronry_tools.sim.oracles.scripts import ScriptCheck
from heronry_tools.sim.oracles.service import ServiceCheck
from heronry_tools.sim.oracles.silence import LeftOut
from heronry_tools.sim.oracles.solitude import Solitude
from heronry_tools.sim.oracles.stale import StaleCheck
from heronry_tools.sim.oracles.tables import TableCheck
from heronry_tools.sim.oracles.terms import TermCheck
from heronry_wire.authentication import Key


@dataclass(frozen=True)
class Given:
    """What the oracles of a flight are told before it begins.

    key: the key of managers and PEs; None without authentication
    read_journal: returns the bytes of the journal of the manager at a station
    brings_tables: whether the managers bring tables to nodes without one
    bundles: code that the managers bring
    """

    key: Key | None = None
    read_journal: Read = lambda _: None
    brings_tables: bool = False
    bundles: Collection[bytes] = ()


class _Lasting:
    """What is about nodes and epochs, whatever the spec."""

    def __init__(self, flown: FlownSpec, other: FlownSpec | None, key: Key | None) -> None:
        spec = flown.spec
        self.proven = None if key is None else ProvenStates(key)
        self.solitude = Solitude(spec)
        self.losses = Losses(spec)
        self.terms = TermCheck(spec, has_key=key is not None)
        self.epochs = EpochCheck(spec, has_digests=key is None)
        self.exclusion = ExclusionCheck(spec) if other is None else ExclusionCheck(spec, other.spec)
        self.channels, self.scripts = ChannelCheck(spec), ScriptCheck()
        self.authenticity = None if key is None else AuthenticityCheck(spec, key)
        self.either = None if other is None else EitherSpecCheck(flown, other, has_key=key is not None)


class Known:
    """Facts about one flight that its oracles share, and those oracles that derive some of these facts."""

    def __init__(
        self, flown: FlownSpec, given: Given, other: FlownSpec | None = None, before: "Known | None" = None
    ) -> None:
        """Create the oracles that derive facts.

        flown: the spec by which the PEs fly, with their tables, by which slices and contingencies are recognized
        other: the spec to which they may change; None: there is none
        before: what was known while they flew by the other spec; None: the flight begins
        """
        spec, key = flown.spec, given.key
        self.flown, self.other, self.given = flown, other, given
        self.spec, self.key, self.read_journal = spec, key, given.read_journal
        self.switched_by: int | None = None  # the epoch by which the PEs have changed to this spec
        self._lasting: _Lasting = _Lasting(flown, other, key) if before is None else before._lasting
        lasting = self._lasting
        self.commanded: Commanded
        self.beside: Commanded | None
        if before is None:
            self.commanded = Commanded(spec, flown.tables.values())
            self.beside = None if other is None else Commanded(other.spec, other.tables.values())
        else:
            assert before.beside is not None
            self.commanded, self.beside = before.beside, before.commanded
        self.proven, self.solitude, self.losses = lasting.proven, lasting.solitude, lasting.losses
        self.terms, self.epochs = lasting.terms, lasting.epochs
        self.exclusion, self.either = lasting.exclusion, lasting.either
        self.channels, self.scripts, self.authenticity = lasting.channels, lasting.scripts, lasting.authenticity
        self.freshness = FreshnessCheck(spec, self.commanded)
        self.witness = Witness(spec)
        self.blame = BlameCheck(spec)
        self.service = ServiceCheck(spec, self.solitude.ended_ns)
        self.left_out = LeftOut(spec, self.commanded.epochs, self.service.in_force)
        self.phases = PhaseCheck(spec, self.service.entered)
        self.priorities = PriorityCheck(spec, self.service.prioritized)
        self.availability = None if key is None else AvailabilityCheck(spec)
        self.stale = StaleCheck(spec, self.commanded, self.epochs)
        self.planned_load = PlannedLoadCheck(spec)
        brings = given.brings_tables or bool(given.bundles)
        self.tables = TableCheck(spec, (flown,) if other is None else (flown, other)) if brings else None
        self.code = CodeCheck(given.bundles) if given.bundles else None
        if before is not None:
            self._take_over(before)

    def changed(self, epoch: int) -> "Known":
        """Return what is known once the PEs change to the other spec by this epoch."""
        assert self.other is not None
        known = Known(self.other, self.given, self.flown, self)
        known.switched_by = epoch
        return known

    def _take_over(self, before: "Known") -> None:
        """Take over what was known while the PEs flew by the other spec, by the names of its elements."""
        self.witness.go_on_from(before.witness)
        self.freshness.take_over(before.freshness)
        self.stale.take_over(before.stale)
        self.blame.take_over(before.blame, self.spec)
        self.service.take_over(before.service)
        self.phases.take_over(before.phases)
        self.priorities.take_over(before.priorities)
        if self.tables is not None and before.tables is not None:
            self.tables.take_over(before.tables)
