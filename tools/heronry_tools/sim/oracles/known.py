"""Facts that several oracles of one flight use: commanded epochs, available PEs, the active manager, the phase.

All facts are derived from the frames, and from the orders and faults of the flight; none is read from a core. Some
facts are derived by oracles. This file creates these oracles, and the list of all oracles (`registry`) has them, too.
"""

from collections.abc import Collection

from heronry_dg.model import Spec
from heronry_tools.recording.commanded import Commanded
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.oracles.availability import AvailabilityCheck
from heronry_tools.sim.oracles.blame import BlameCheck
from heronry_tools.sim.oracles.code import CodeCheck
from heronry_tools.sim.oracles.epochs import EpochCheck
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
from heronry_wire.pe_table import PeTable


class Known:
    """Facts about one flight that its oracles share, and those oracles that derive some of these facts."""

    def __init__(
        self,
        spec: Spec,
        tables: Collection[PeTable],
        key: Key | None,
        read_journal: Read,
        *,
        brings_tables: bool = False,
        bundles: Collection[bytes] = (),
    ) -> None:
        """Create the oracles that derive facts.

        tables: the tables of the PEs, by which slices and contingencies are recognized.
        key: the key of managers and PEs; None without authentication.
        read_journal: returns the bytes of the journal of the manager at a station.
        brings_tables: whether the managers bring tables to nodes without one.
        bundles: code that the managers bring.
        """
        self.spec, self.key, self.read_journal = spec, key, read_journal
        self.commanded = Commanded(spec, tables)
        self.proven = None if key is None else ProvenStates(key)
        self.solitude = Solitude(spec)
        self.losses = Losses(spec)
        self.witness = Witness(spec)
        self.terms = TermCheck(spec, has_key=key is not None)
        self.epochs = EpochCheck(spec, has_digests=key is None)
        self.blame = BlameCheck(spec)
        self.service = ServiceCheck(spec, self.solitude.ended_ns)
        self.left_out = LeftOut(spec, self.commanded.epochs, self.service.in_force)
        self.phases = PhaseCheck(spec, self.service.entered)
        self.priorities = PriorityCheck(spec, self.service.prioritized)
        self.scripts = ScriptCheck()
        self.availability = None if key is None else AvailabilityCheck(spec)
        self.stale = StaleCheck(spec, self.commanded, self.epochs)
        self.planned_load = PlannedLoadCheck(spec)
        self.tables = TableCheck(spec, {one.name: one for one in tables}) if brings_tables or bundles else None
        self.code = CodeCheck(bundles) if bundles else None
