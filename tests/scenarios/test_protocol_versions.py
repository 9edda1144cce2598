"""Fleets of two versions of the protocol: another minor flies along, another major stages nothing and is named.

The nodes of the later minor are cores of today with one thing more of each kind by which the protocol grows: a new fact
of a PE (an EMCY code), a new order (an operation of CONTROL), a new object and a new field of the table.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.canopen import canopen_node
from heronry_agent.core.canopen.object_dictionary import ObjectDictionary
from heronry_agent.core.canopen.pe_objects import PeObjects
from heronry_agent.core.vocabulary import Action, Event
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.vocabulary import ManagerAction, ManagerEvent
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world import simulated_manager, simulated_pe
from heronry_tools.sim.world.bus import Sent
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, Command, emcy_id, management_id, sdo_request_id, sdo_response_id
from heronry_wire.management import Control, Operation, decode_command
from heronry_wire.pe_table import PeTable, with_check_sum
from heronry_wire.protocol_version import PROTOCOL, Version
from heronry_wire.sansio import Received, Send
from heronry_wire.sdo import UPLOAD, Abort, with_number
from scenarios.flights import KEY, MS, big_blue, two_tails

LATER, OTHER = Version(PROTOCOL.major, PROTOCOL.minor + 1), Version(PROTOCOL.major + 1, 0)
NEW_ORDER, NEW_CODE, NEW_OBJECT = Operation(63), 0xFF7E, 0x20FF
ORDER_EVERY_NS = 200 * MS
KEYS = pytest.mark.parametrize("key", [None, KEY], ids=["without a key", "with a key"])


class LaterObjects(PeObjects):
    def dictionary(self) -> ObjectDictionary:
        found = super().dictionary()
        known = found.read
        read: Callable[[int, int], bytes | Abort] = lambda index, sub_index: (  # noqa: E731
            b"\x2a\0\0\0" if index == NEW_OBJECT else known(index, sub_index)
        )
        found.read = read  # type: ignore[method-assign]
        return found


class LaterAgent(AgentCore):
    """Executes the new order: it tells the new fact."""

    def __init__(self, table: PeTable, *arguments: Any, **named: Any) -> None:
        super().__init__(table, *arguments, **named)
        self._node = table.node_id

    def step(self, now_ns: int, event: Event) -> list[Action]:
        actions = super().step(now_ns, event)
        if isinstance(event, Received) and event.frame.can_id == management_id(FIRST_MANAGER, Command.CONTROL):
            order = decode_command(Command.CONTROL, event.frame.data)
            if isinstance(order, Control) and (order.node, order.operation) == (self._node, NEW_ORDER):
                code = NEW_CODE.to_bytes(2, "little")
                actions = [*actions, Send(0, Frame(emcy_id(self._node), code + bytes((0, 0, 0, 0, 0, 7))))]
        return actions


class LaterManager(ManagerCore):
    """Gives the new order to each PE in turn."""

    orders = 0

    def step(self, now_ns: int, event: ManagerEvent) -> list[ManagerAction]:
        actions = super().step(now_ns, event)
        if self.is_active and now_ns // ORDER_EVERY_NS > self.orders:
            self.orders = now_ns // ORDER_EVERY_NS
            pes = list(self._settings.spec.pes.values())
            order = Control(self.term, pes[self.orders % len(pes)].node_id, NEW_ORDER)
            send: list[ManagerAction] = [Send(0, Frame(management_id(FIRST_MANAGER, Command.CONTROL), order.encode()))]
            seal = self._claim._turn.seal
            actions = [*actions, *(send if seal is None else seal(send))]
        return actions


def later_table(table: PeTable) -> PeTable:
    """The table as a compiler of the later minor writes it, read by an agent of today."""
    content = json.loads(table.to_json())
    del content["sha256"]
    content["protocol"]["minor"] = LATER.minor
    content["later"] = {"anything": [1, 2]}
    content["ports"][0]["later"] = 5
    return PeTable.from_json(with_check_sum(content))


def fleet(
    monkeypatch: pytest.MonkeyPatch,
    key: Key | None,
    *,
    tables: Callable[[str, PeTable], PeTable] = lambda _, table: table,
    later: frozenset[str] = frozenset(),
    manager: type[ManagerCore] = ManagerCore,
    spec: Any = two_tails,
) -> Simulation:
    """Begin a flight in which the PEs `later` are of the later minor."""

    def agent(table: PeTable, *arguments: Any, **named: Any) -> AgentCore:
        is_later = table.name in later
        with monkeypatch.context() as patch:
            patch.setattr(canopen_node, "PeObjects", LaterObjects if is_later else PeObjects)
            return (LaterAgent if is_later else AgentCore)(table, *arguments, **named)

    monkeypatch.setattr(simulated_pe, "AgentCore", agent)
    monkeypatch.setattr(
        simulated_manager,
        "ManagerCore",
        lambda *arguments, **named: manager(*arguments, **{**named, "reads_objects": True}),
    )
    simulation = Simulation(spec(), 1, key=key, keep_trace=True)
    simulation.fleet.tables = {pe: tables(pe, table) for pe, table in simulation.fleet.tables.items()}
    return simulation


def object_of(simulation: Simulation, pe: str, index: int) -> bytes:
    """Read an object of a PE over the bus; returns the answer's eight bytes."""
    node = simulation.fleet.tables[pe].node_id
    answers: list[bytes] = []
    wire = next(iter(simulation.wiring.buses.values()))
    station = wire.join("desk", 0, lambda _port, _event: None, ())

    def take(sent: Sent) -> None:
        if sent.frame.can_id == sdo_response_id(node):
            answers.append(sent.frame.data)

    simulation.wiring.tap(wire.name, take)
    wire.offer(station, Frame(sdo_request_id(node), with_number(UPLOAD, index, 0, 0)))
    simulation.run_for(50 * MS)
    wire.leave(station)
    return answers[-1]


@KEYS
def test_a_pe_of_another_major_stages_nothing_and_is_named_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, key: Key | None
) -> None:
    monkeypatch.setattr("heronry_agent.core.canopen.pe_objects.PROTOCOL", OTHER)

    def tables(pe: str, table: PeTable) -> PeTable:
        return replace(table, protocol=OTHER) if pe == "control_pe" else table

    simulation = fleet(monkeypatch, key, tables=tables)
    simulation.run_for(3_000 * MS)
    refusals = simulation.events_of(events.PeRefused)
    assert {(one.pe, one.reason) for one in refusals} == {("control_pe", "DIGEST")}
    (told,) = simulation.events_of(events.AnotherTable)
    assert told.pe == "control_pe"
    assert told.why == (
        f"it speaks protocol {OTHER}, and this manager {PROTOCOL}: install the same major version of heronry for both, "
        "and write its table anew with 'heronry table'"
    )
    staged = simulation.fleet.running["control_pe"].core.active_configuration.running
    assert staged.epoch == 0
    flown = simulation.managers.foremost
    assert flown is not None
    assert flown.core.plan is not None
    assert {running.pe for running in flown.core.plan.configuration.modules.values()} <= {"sensor_pe", "tail_pe"}
    assert simulation.fleet.running["tail_pe"].core.active_configuration.running.epoch > 0


@KEYS
@pytest.mark.parametrize("manager", [ManagerCore, LaterManager], ids=["a manager of today", "a later manager"])
def test_nodes_of_another_minor_fly_along_and_what_they_add_harms_nobody(
    monkeypatch: pytest.MonkeyPatch, key: Key | None, manager: type[ManagerCore]
) -> None:
    later = frozenset({"tail_pe"})
    simulation = fleet(
        monkeypatch, key, later=later, manager=manager, tables=lambda pe, one: later_table(one) if pe in later else one
    )
    simulation.run_for(3_000 * MS)
    assert simulation.settle() == []
    assert simulation.events_of(events.PeLost) == simulation.events_of(events.PeRefused) == []
    control = management_id(FIRST_MANAGER, Command.CONTROL)
    orders = [sent for sent in simulation.trace if sent.frame.can_id == control and sent.frame.data[3] == NEW_ORDER]
    facts = [
        sent
        for sent in simulation.trace
        if sent.frame.can_id == emcy_id(94) and sent.frame.data[:2] == NEW_CODE.to_bytes(2, "little")
    ]
    assert bool(orders) is bool(facts) is (manager is LaterManager)
    assert len(facts) == sum(sent.frame.data[2] == 94 for sent in orders)
    counted = {cause for node in simulation.fleet.running.values() for cause, _ in node.core.counts}
    assert not {cause for cause in counted if "malformed" in cause or "unproven" in cause}
    assert object_of(simulation, "tail_pe", NEW_OBJECT)[4:] == b"\x2a\0\0\0"
    assert object_of(simulation, "sensor_pe", NEW_OBJECT)[0] == 0x80  # abort: there is no such object


def test_a_gateway_forwards_an_order_of_a_later_minor(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = fleet(monkeypatch, None, manager=LaterManager, later=frozenset({"ground"}), spec=big_blue)
    simulation.run_for(6_000 * MS)
    ground = simulation.fleet.tables["ground"].node_id
    new_fact = NEW_CODE.to_bytes(2, "little")
    reports = [sent for sent in simulation.trace if sent.frame.can_id == emcy_id(ground)]
    assert {sent.bus for sent in reports if sent.frame.data[:2] == new_fact} == {"can0", "radio"}


def test_every_operation_of_today_is_an_operation() -> None:
    for operation in Operation:
        message = decode_command(Command.CONTROL, Control(1, 92, operation).encode())
        assert isinstance(message, Control)
        assert message.operation is operation
    assert decode_command(Command.CONTROL, Control(1, 92, NEW_ORDER).encode()) == Control(1, 92, NEW_ORDER)
