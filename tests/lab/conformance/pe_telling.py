"""What a PE records for its operator: a line in its log for each change, and counts of refused and malformed frames."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.vocabulary import ChannelsLost
from heronry_agent.module import Context, Inputs, Value
from heronry_wire.canopen_objects import COUNTERS, DEVICE_NAME, STORED_EDS
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.frame import Frame
from heronry_wire.identification import REQUEST_ID
from heronry_wire.identifiers import (
    NMT_ID,
    Command,
    actuator_echo_id,
    management_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import Activate, Alive, ElementKind, Emergency, FaultCode, Lease, Ping, Prepare, Step
from heronry_wire.pe_table import Port
from heronry_wire.sdo import UPLOAD, with_data
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    DEMAND,
    DEMAND_ID,
    EVERYTHING,
    FAR,
    GAUGE,
    HELPER,
    INCARNATION,
    LAMP,
    MAIN,
    NEIGHBOUR,
    NODE,
    TABLE,
    PeUnderTest,
    datum,
)
from lab.conformance.player import MS, demand, equal
from lab.peers import command_frame

_FAR_PORT = Port("far", 500_000, 50 * MS, 3, wireless=False, channels=1, nodes=(FAR,))
_GATEWAY = replace(TABLE, ports=(MAIN, _FAR_PORT))
_PAGE = StatePage0(PeState.UNCONFIGURED, PeFlags(0), 1, 0, 0, 0).encode()


def what_it_does_not_accept_is_counted() -> None:
    """Each refused frame is counted once; frames for other nodes, or without a meaning here, are not counted."""
    pe = PeUnderTest(_GATEWAY).attended()
    pe.flies(Slice((ModuleSlice(LAMP, 0, (DEMAND,)),), remote={DEMAND: NEIGHBOUR}))
    ping, request = command_frame(Ping(5, NODE, 0)), Frame(sdo_request_id(NODE), with_data(UPLOAD, DEVICE_NAME, 0))
    for counted, player, frame in (
        (1, pe.main, Frame(NMT_ID, bytes((1,)))),
        (1, pe.main, Frame(NMT_ID, bytes((77, NODE)))),
        (1, pe.main, Frame(NMT_ID, bytes((2, NODE)))),
        (1, pe.main, Frame(NMT_ID, bytes((2, 0)))),
        (0, pe.main, Frame(NMT_ID, bytes((2, NODE + 1)))),
        (1, pe.far, Frame(NMT_ID, bytes((2, NODE)))),
        (1, pe.main, request._replace(data=request.data[:7])),
        (0, pe.main, Frame(sdo_request_id(NODE + 1), request.data)),
        (1, pe.far, request),
        (1, pe.main, Frame(REQUEST_ID, b"\1\2")),
        (1, pe.far, Frame(REQUEST_ID, b"\1\2")),
        (0, pe.main, ping),
        (0, pe.main, command_frame(Ping(5, NODE + 1, 0))),
        (1, pe.main, command_frame(Ping(4, NODE, 0))),
        (1, pe.main, command_frame(Ping(5, NODE, 0), 127)),
        (1, pe.main, ping._replace(data=ping.data[:3])),
        (1, pe.far, ping),
        (1, pe.far, command_frame(Lease(5, 0, Step.PREPARED, 0))),
        (1, pe.far, command_frame(Alive(5, 0, frozenset()))),
        (1, pe.main, Frame(management_id(126, Command.LEASE), b"\0\5")),
        (1, pe.main, Frame(management_id(126, Command.ALIVE), b"\0\5")),
        (1, pe.main, Frame(state_id(NEIGHBOUR), _PAGE[:7])),
        (0, pe.main, Frame(state_id(NEIGHBOUR), _PAGE)),
        (1, pe.main, Frame(state_id(NODE), _PAGE)),
        (1, pe.main, Frame(actuator_echo_id(NODE), bytes(8))),
        (1, pe.main, datum(DEMAND_ID, 1.0, node=NEIGHBOUR + 1)),
        (1, pe.main, datum(DEMAND_ID, 1.0)._replace(data=bytes(3))),
        (0, pe.main, datum(DEMAND_ID, 1.0)),
        (1, pe.main, ping._replace(extended=True)),
        (0, pe.main, Frame(900, bytes(8), extended=True)),
    ):
        pe.run_into_next_period(5)
        before = pe.counted
        player.say(frame)
        pe.run(2)
        equal(pe.counted - before, counted, f"counted after {frame} on {player.bus.name}")


def what_is_held_back_is_counted() -> None:
    """Counted are steps and writes of a branch, frames of a movable module, and reports of unknown elements."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies()
    before = pe.counted
    pe.run(200)
    equal(pe.counted, before, "counted while all is well")
    pe.alive = frozenset()
    pe.run(45)
    before = pe.counted
    pe.run(200)
    demand(15 <= pe.counted - before <= 26, f"counted while outputs are held for 200 ms: {pe.counted - before}")
    pe.alive = frozenset((NODE,))
    pe.run(100)
    for behaviour in (
        puppets.asking("nowhere"),
        puppets.reporting("device:nothing"),
        puppets.giving(height=1.0, help=1),
    ):
        puppets.BEHAVIOUR["helper"] = behaviour
        pe.run(30)
        before = pe.counted
        pe.run(200)
        demand(9 <= pe.counted - before <= 12, f"counted in 200 ms: {pe.counted - before}")


def what_changes_is_noted() -> None:
    """There is one note for each change: start, term, step, lease, outputs, faults, phases, node-ID clash."""
    pe = PeUnderTest()
    pe.run(30)
    equal(
        pe.notes("start"),
        ["PE one of trial, node 95", "no key: any node on the bus can command this PE"],
        "notes of its start",
    )
    pe.attended()
    puppets.behave_normally()
    equal(len(pe.notes("term")), 1, "notes of a term")
    equal(pe.notes("lease"), ["a manager is heard"], "notes of a lease")
    pe.flies(EVERYTHING)
    pe.run(1200)
    equal(pe.notes("step"), ["epoch 17 at GO_ALL: ACTIVE"], "notes of a step")
    before = len(pe.notes("output"))
    lease = pe.lease
    pe.lease = pe.alive = None
    pe.run(300)
    equal(pe.notes("lease")[1:], ["no manager is heard; all modules go on"], "notes when the manager is gone")
    pe.lease = lease
    pe.run(100)
    equal(len(pe.notes("lease")), 3, "notes of a lease")
    pe.alive = frozenset()
    pe.run(100)
    pe.alive = frozenset((NODE,))
    pe.run(1200)
    equal(
        pe.notes("output")[before:],
        ["exclusive outputs are held back", "exclusive outputs are authorized"],
        "of outputs",
    )
    puppets.BEHAVIOUR["helper"] = puppets.asking("land")
    puppets.BEHAVIOUR["gauge"] = puppets.reporting("device:gauge_sensor")
    pe.run(200)
    equal(len(pe.notes("phase")), 1, "notes of a phase")
    equal(len(pe.notes("fault")), 1, "notes of a fault")
    puppets.BEHAVIOUR["helper"] = puppets.raising
    pe.run(400)
    equal(len(pe.notes("restart")), 2, "notes of restarts")
    equal(len(pe.notes("fault")), 2, "notes of faults")
    for _ in range(2):
        pe.main.say(Frame(state_id(NODE), _PAGE))
        pe.run(5)
    equal(len(pe.notes("clash")), 1, "notes of a clash")


def releases_that_were_missed_are_counted() -> None:
    """After a standstill of the processor one release of each module is made up; the others are skipped and counted."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(Slice((ModuleSlice(GAUGE, 0, ()), ModuleSlice(HELPER, 0, ()))))
    equal(pe.object(COUNTERS, 2), 0, "releases that were missed")
    steps: list[int] = []

    def counts(_ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        steps.append(pe.now_ns)
        return {}

    puppets.BEHAVIOUR["helper"] = counts
    began_ns = pe.now_ns
    pe.pe.pause(210 * MS)
    pe.run(300)
    equal(len([t_ns for t_ns in steps if t_ns < began_ns + 211 * MS]), 1, "steps that are made up for")
    equal(len(steps), 5, "steps in 90 ms after it, with that one")
    missed = pe.object(COUNTERS, 2)
    demand(18 <= missed <= 20, f"in 210 ms two modules of 50 Hz have missed {missed} releases")


def requests_by_sdo_wait_for_their_turn() -> None:
    """In flight SDO takes a tenth of the bus; four requests wait, and further ones are counted and dropped."""
    pe = PeUnderTest().attended().flies(Slice((ModuleSlice(GAUGE, 0, ()), ModuleSlice(HELPER, 0, ()))))
    pe.run_into_next_period(5)
    before = pe.counted
    pe.run(10)
    began_ns = pe.now_ns
    request = Frame(sdo_request_id(NODE), with_data(UPLOAD, DEVICE_NAME, 0))
    pe.main.say(*([request] * 8))
    pe.run(30)
    answers = pe.main.since(began_ns, [sdo_response_id(NODE)])
    equal(len(answers), 5, "answers to eight requests together")
    apart = [later.t_ns - earlier.t_ns for earlier, later in pairwise(answers)]
    demand(all(2.5 * MS < gap < 3 * MS for gap in apart), f"answers are {apart} ns apart")
    pe.run(10)
    equal(pe.counted - before, 3, "requests that were dropped")
    began_ns = pe.now_ns
    pe.main.say(Frame(sdo_request_id(NODE), with_data(UPLOAD, STORED_EDS, 0)))
    pe.run(10)
    equal(len(pe.main.since(began_ns, [sdo_response_id(NODE)])), 1, "answers to one request")


def an_echo_of_another_pe_moves_the_plant() -> None:
    """An echo counts only for an actuator of the echoing node, and only with a number."""
    pe = PeUnderTest(_GATEWAY).attended()
    identifier = actuator_echo_id(NEIGHBOUR)
    for frame, moves in (
        (_echo(identifier, NEIGHBOUR, 2, 2), True),
        (_echo(identifier, NEIGHBOUR, 2, 1), False),  # the device of another node
        (_echo(identifier, NEIGHBOUR, 2, 3), False),  # no device
        (_echo(identifier, NODE, 2, 2), False),  # another sender
        (_echo(identifier, NEIGHBOUR, 4, 2), False),  # no FLOAT
        (_echo(identifier, NEIGHBOUR, 2, 2)._replace(data=bytes(3)), False),
    ):
        pe.pe.followed.clear()
        pe.main.say(frame)
        pe.run(3)
        equal([device for device, _ in pe.pe.followed], ["rudder_motor"] if moves else [], f"moved by {frame}")


def an_echo_that_nothing_here_feels_moves_nothing() -> None:
    """A plant moves with the actuators that its sensors measure; a gateway forwards the echoes of all others."""
    moved, handed_on = _echo(actuator_echo_id(NEIGHBOUR), NEIGHBOUR, 2, 2), _echo(actuator_echo_id(FAR), FAR, 2, 2)
    for felt, moves in (("rudder_motor", True), ("servo_motor", False)):
        pe = PeUnderTest(_GATEWAY)
        pe.pe.core = AgentCore(_GATEWAY, INCARNATION, pe.pe.time.now_ns(), followed=(felt,))
        pe.attended()
        began_ns = pe.now_ns
        pe.main.say(moved)
        pe.far.say(handed_on)
        pe.run(3)
        told = [device for device, _ in pe.pe.followed]
        equal(told, ["rudder_motor"] if moves else [], f"moved by an echo of rudder_motor, where {felt} is felt")
        found = [one.frame for one in pe.main.since(began_ns, [handed_on.can_id])]
        equal(found, [handed_on], f"an echo from beyond, where {felt} is felt")


def _echo(identifier: int, node: int, kind: int, device: int) -> Frame:
    return Frame(identifier, bytes((node, kind, device, 0, 0x3F, 0x80, 0, 0)))


def a_step_that_changes_nothing_is_not_undone() -> None:
    """GO after GO_ALL, BREAK after GO, PREPARE and slices of what runs: the PE goes on unchanged."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies()
    before = len(pe.notes("step"))
    for message in (
        Activate(5, 17, Step.BREAK, 0x111111),
        Activate(5, 17, Step.GO, 0x111111),
        Lease(5, 17, Step.BREAK, 0x111111),
        Prepare(5, 17, 0x111111),
        *pe.slice_frames(17, EVERYTHING),
    ):
        pe.main.command(message)
        pe.run(5)
        page = pe.pinged()
        equal((page.state, page.epoch), (PeState.ACTIVE, 17), f"after {message}")
    equal(len(pe.notes("step")), before, "steps that were taken")
    began_ns = pe.run(60)
    demand(bool([t for t in pe.drives if t > began_ns]), "its branch is not driven any more")


def a_lost_channel_is_told_every_second() -> None:
    """The PE reports it immediately, and every second while it lasts; its end once. It is not acknowledged."""
    pe = PeUnderTest().attended()
    lost = [Emergency(FaultCode.CHANNEL_LOST, 0x11, ElementKind.CHANNEL, 0, number) for number in (1, 2)]
    back = [Emergency(FaultCode.CHANNEL_BACK, 0, ElementKind.CHANNEL, 0, number) for number in (1, 2)]
    for channels, immediate, later in (
        ((1,), [lost[0]], [lost[0]]),
        ((1, 2), [lost[1]], lost),
        ((2,), [back[0]], [lost[1]]),
        ((), [back[1]], []),
        ((), [], []),
    ):
        began_ns = pe.now_ns
        pe.tell(ChannelsLost(0, frozenset(channels)))
        pe.run(2)
        equal([said for _, said in pe.emergencies(began_ns)], immediate, f"EMCYs when {channels} are lost")
        began_ns = pe.run(990)
        equal(pe.emergencies(began_ns), [], "EMCYs within a second")
        pe.run(20)
        equal([said for _, said in pe.emergencies(began_ns)], later, "EMCYs after a second")
    equal(len(pe.notes("channel")), 5, "notes of channels")
    demand(PeFlags.FAULT_PENDING not in pe.pinged().flags, "a lost channel is pending")
