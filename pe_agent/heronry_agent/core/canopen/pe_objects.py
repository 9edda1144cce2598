"""The values of the CANopen objects of a PE, read from the parts of its agent when a client reads them.

The two long texts, the EDS and the table, are made at the first read and kept. All other values are made anew at each
read. A client can write these objects:

    heartbeat time      any time that `network_management` admits
    number of errors    only 0, which empties the list of errors
    table               - A PE that waits for a table (`table_waiting`) takes a table that can be used, and that has the
                          node-ID of this PE
                        - A PE that has a table accepts only the same table again
                        - A PE that runs a configuration takes another table beside its own (`table_change`), or none if
                          its agent takes none
                        A table comes whole (2020h), or in parts (2026h, `received_parts`); then it is the same

    program, its parts, program control     only where this PE has a loader (`programs`)

With a key, a client can write only while the PE is unlocked (`authenticity`), and a table must be sealed for the
challenge that the client has read.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cache, partial

from heronry_agent.core.authority import Authenticity, FollowedManager
from heronry_agent.core.canopen.network_management import NetworkManagement
from heronry_agent.core.canopen.node_services import NodeServices
from heronry_agent.core.canopen.object_dictionary import MOST_BYTES, BytesWriter, NumberWriter, ObjectDictionary, Place
from heronry_agent.core.canopen.programs import Programs
from heronry_agent.core.canopen.received_parts import ReceivedParts
from heronry_agent.core.configuration import ActiveConfiguration
from heronry_agent.core.modules import RunningModules
from heronry_agent.core.reports import Facts
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import Failure
from heronry_wire.canopen_objects import (
    CHALLENGE,
    COST,
    COUNTERS,
    ERROR_HISTORY,
    ERROR_REGISTER,
    HEARTBEAT_TIME,
    MASTERSHIP,
    MODULE_FAILURES,
    MODULE_IMAGES,
    MODULE_INDICES,
    MODULE_MODES,
    MODULE_NAMES,
    MODULE_STATES,
    MODULE_TRACEBACKS,
    OFFER,
    PROGRAM_CONTROL,
    PROGRAM_DATA,
    PROGRAM_STATUS,
    PROGRAM_TRANSFER,
    PROGRAM_VERSION,
    SPEC,
    STATE,
    STORED_EDS,
    TABLE,
    TABLE_TRANSFER,
    TIME,
)
from heronry_wire.compressed_table import table_bytes
from heronry_wire.eds import eds_text
from heronry_wire.management import NO_EPOCH
from heronry_wire.node_cost import NodeCost
from heronry_wire.pe_table import ModuleEntry, PeTable, TableError
from heronry_wire.protocol_version import PROTOCOL
from heronry_wire.sdo import Abort
from heronry_wire.state_frames import PeFlags

_NOT_WANTED, _RUNNING, _HELD, _FAILED, _NOT_STARTED = range(5)
_NS_PER_MS = 1_000_000
_PROGRAM_STARTED = 1  # CiA 302-3, object 1F51h
_NOT_MEASURED = NodeCost(0xFFFF_FFFF, 0xFFFF_FFFF, 0xFFFF_FFFF, 0xFFFF_FFFF)


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of an agent that `PeObjects` and `CanopenNode` use.

    facts: returns the present content of the state frames.
    take_table: takes a table that differs from the present one, and returns None, or the abort code with which
        it refuses. If `take_table` is None, such a table is always refused.
    flies_by_two: a table may come while this PE runs something, and is then beside the one that flies.
    authenticity: tells whether writes are unlocked, and opens sealed tables; None without a key.
    cost: returns what this node costs its computer, or None while that is not known.
    programs: the door to the loader; None where this PE has no loader.
    table_parts: what has come of a table that comes in parts.
    offer: what a node without a table offers, for `heronry adopt`.
    """

    turn: Turn
    index: TableIndex
    incarnation: int
    followed_manager: FollowedManager
    active_configuration: ActiveConfiguration
    modules: RunningModules
    facts: Callable[[], Facts]
    take_table: Callable[[bytes], Abort | None] | None = None
    authenticity: Authenticity | None = None
    cost: Callable[[], NodeCost | None] = lambda: None
    programs: Programs | None = None
    table_parts: ReceivedParts = field(default_factory=ReceivedParts)
    offer: str = ""
    flies_by_two: bool = False


class PeObjects:
    """Reads and writes the values of the CANopen objects of one PE."""

    def __init__(self, parts: Parts, network: NetworkManagement, services: NodeServices) -> None:
        self._parts, self._network, self._services = parts, network, services
        self._told: tuple[PeTable, bytes] | None = None

    def _table(self) -> bytes:
        table = self._parts.index.table
        if self._told is None or self._told[0] is not table:
            self._told = table, table.to_json().encode()
        return self._told[1]

    @property
    def _entries(self) -> Collection[ModuleEntry]:
        return self._parts.index.modules.values()

    def dictionary(self) -> ObjectDictionary:
        """Return the object dictionary of this PE; it reads and writes values by functions of this `PeObjects`."""
        programs = self._parts.programs
        number_writers: dict[Place, NumberWriter] = {
            (HEARTBEAT_TIME, 0): self._set_heartbeat,
            (ERROR_HISTORY, 0): self._forget_errors,
        }
        bytes_writers: dict[Place, BytesWriter] = {
            (TABLE, 0): self._take_table,
            (TABLE_TRANSFER, 1): self._take_table_part,
        }
        if programs is not None:
            number_writers[PROGRAM_CONTROL, 1] = programs.order
            bytes_writers |= {(PROGRAM_DATA, 1): programs.write, (PROGRAM_TRANSFER, 1): programs.write_part}
        return ObjectDictionary(
            self._parts.index.node,
            readers={
                (ERROR_REGISTER, 0): lambda: self._parts.modules.faults.register,
                (HEARTBEAT_TIME, 0): lambda: self._network.heartbeat_ms,
                (STORED_EDS, 0): cache(lambda: eds_text().encode()),
                (PROGRAM_CONTROL, 1): lambda: _PROGRAM_STARTED if programs is None else programs.control,
                (PROGRAM_VERSION, 1): lambda: 0 if programs is None else programs.version,
                (PROGRAM_STATUS, 1): lambda: 0 if programs is None else programs.status,
                (PROGRAM_TRANSFER, 2): lambda: b"" if programs is None else programs.received,
                (PROGRAM_TRANSFER, 3): lambda: b"" if programs is None else programs.active,
                (TABLE, 0): self._table,
                (TABLE_TRANSFER, 2): lambda: self._parts.table_parts.encoded,
                **{(STATE, number): partial(self._state, number) for number in range(1, 11)},
                (SPEC, 1): lambda: self._parts.index.table.name,
                (SPEC, 2): lambda: self._parts.index.table.spec,
                (SPEC, 3): lambda: self._parts.index.table.spec_digest,
                (SPEC, 4): lambda: PROTOCOL.number,
                (MASTERSHIP, 1): lambda: self._parts.followed_manager.manager,
                (MASTERSHIP, 2): lambda: self._parts.followed_manager.term,
                (MASTERSHIP, 3): lambda: int(PeFlags.HEARS_LEASE in self._parts.facts().flags),
                (COUNTERS, 1): lambda: sum(self._parts.turn.counts.values()),
                (COUNTERS, 2): lambda: sum(self._parts.modules.schedule.overruns.values()),
                (COUNTERS, 3): lambda: self._parts.turn.standstills.times,
                (COUNTERS, 4): lambda: self._parts.turn.standstills.long_times,
                (COUNTERS, 5): lambda: self._parts.turn.standstills.last_long_ns // _NS_PER_MS,
                (COUNTERS, 6): lambda: self._parts.turn.standstills.longest_ns // _NS_PER_MS,
                (CHALLENGE, 0): self._challenge,
                (OFFER, 0): lambda: self._parts.offer,
                (TIME, 1): lambda: self._services.time_stamp,
                (TIME, 2): lambda: self._services.time_age_ms(self._parts.turn.now_ns),
                **{(COST, number): partial(self._cost, number) for number in range(1, 5)},
            },
            arrays={
                ERROR_HISTORY: lambda: self._parts.modules.faults.history.errors,
                MODULE_NAMES: lambda: [entry.name for entry in self._entries],
                MODULE_INDICES: lambda: [entry.index for entry in self._entries],
                MODULE_IMAGES: lambda: [entry.image for entry in self._entries],
                MODULE_STATES: lambda: [self._module_state(entry.index) for entry in self._entries],
                MODULE_MODES: lambda: [self._module_mode(entry.index) for entry in self._entries],
                MODULE_FAILURES: lambda: [self._failure(entry.index).reason for entry in self._entries],
                MODULE_TRACEBACKS: lambda: [self._failure(entry.index).traceback for entry in self._entries],
            },
            number_writers=number_writers,
            bytes_writers=bytes_writers,
            takes_bytes=self._takes_bytes,
        )

    def _takes_bytes(self, index: int) -> bool:
        if index in (TABLE, TABLE_TRANSFER):
            return self._parts.flies_by_two or self._parts.active_configuration.running.epoch == NO_EPOCH
        return self._parts.programs is not None and self._parts.programs.takes_bytes()

    def _state(self, number: int) -> int:
        """Return the value at sub-index `number` of object 2000h, the state of the PE."""
        facts, running = self._parts.facts(), self._parts.active_configuration.running
        return (
            facts.state,
            facts.flags,
            self._parts.incarnation,
            facts.epoch,
            facts.digest,
            running.slice_digest,
            facts.staged_epoch,
            facts.staged_digest,
            facts.reason,
            facts.load,
        )[number - 1]

    def _cost(self, number: int) -> int:
        """Return the value at sub-index `number` of object 2023h."""
        cost = self._parts.cost() or _NOT_MEASURED
        return (cost.wake_ups_per_s, cost.agent_per_mille, cost.modules_per_mille, cost.longest_turn_us)[number - 1]

    def _module_state(self, module: int) -> int:
        active_configuration = self._parts.active_configuration
        if module in active_configuration.live:
            return _RUNNING
        if module in active_configuration.held:
            return _HELD
        if module in active_configuration.failed:
            return _FAILED
        wanted = {one.module for one in active_configuration.running.slice.modules}
        return _NOT_STARTED if module in wanted else _NOT_WANTED

    def _challenge(self) -> int:
        authenticity = self._parts.authenticity
        return 0 if authenticity is None else authenticity.challenge

    def _module_mode(self, module: int) -> str:
        mode = self._parts.active_configuration.live.get(module)
        return "" if mode is None else self._parts.index.modules[module].modes[mode].name

    def _failure(self, module: int) -> Failure:
        return self._parts.modules.failures.last(module)

    def _set_heartbeat(self, time_ms: int) -> Abort | None:
        if not self._network.admits_heartbeat(time_ms):
            return Abort.VALUE
        self._network.set_heartbeat(time_ms, self._parts.turn.now_ns)
        return None

    def _forget_errors(self, _zero: int) -> None:
        self._parts.modules.faults.history.clear()

    def _take_table_part(self, written: bytes) -> Abort | None:
        whole = self._parts.table_parts.take(written)
        return self._take_table(whole) if isinstance(whole, bytes) else whole

    def _take_table(self, written: bytes) -> Abort | None:
        authenticity = self._parts.authenticity
        content = written if authenticity is None else authenticity.opened(written)
        if content is None:
            self._parts.turn.note("table", "a table is refused: no seal of this fleet's key, for this start")
            return Abort.VALUE
        try:
            text = table_bytes(content, MOST_BYTES)
        except TableError as error:
            self._parts.turn.note("table", f"a table is refused: {error}")
            return Abort.VALUE
        flies = self._parts.active_configuration.running.epoch != NO_EPOCH
        if not (flies and self._parts.flies_by_two) and text.strip() == self._table():
            return None
        take = self._parts.take_table
        return Abort.DEVICE_STATE if take is None else take(text)
