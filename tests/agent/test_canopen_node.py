"""A PE as CANopen and CANaerospace tools see it: an unmodified client reads, writes and commands its core."""

import pytest
from canopen.sdo.exceptions import SdoCommunicationError

from agent.canopen_master import Master, refusal
from agent.one_pe import (
    CONTROL,
    DEMAND_ID,
    FLYING,
    GATEWAY_TABLE,
    MANAGER,
    MONITOR,
    MS,
    NODE,
    SERVO_1,
    SERVO_2,
    TABLE,
    OnePe,
    pages,
)
from heronry_agent.core.agent import AgentCore
from heronry_agent.core.canopen.network_management import NetworkManagement
from heronry_agent.core.vocabulary import Action, ImagesMissing, Note, StartFailed
from heronry_wire.canopen_objects import SHORTEST_HEARTBEAT_MS
from heronry_wire.eds import eds_text
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id, state_id
from heronry_wire.management import FaultCode, Lease, Step
from heronry_wire.node_cost import NodeCost
from heronry_wire.protocol_version import PROTOCOL
from heronry_wire.sansio import Send
from heronry_wire.standstill import StoodStill
from heronry_wire.state_frames import PeState

BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
START, STOP, ENTER_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
SECOND = 1_000 * MS


@pytest.fixture
def master() -> Master:
    pe = OnePe()
    pe.pass_time(1 * MS)
    return Master(pe)


# Objects


def test_every_object_of_the_eds_is_served_in_its_type(master: Master) -> None:
    read = {}
    for one in master.sdo.values():
        variables = [one] if not hasattr(one, "values") else [one[0], *one.values()]
        for variable in variables:
            if variable.od.access_type != "wo":
                data = variable.get_data()
                assert not variable.od.fixed_size or len(data) == len(variable.od) // 8
                read[variable.od.index, variable.od.subindex] = data
    assert read[0x1018, 0] == b"\4"
    assert len(read) > 60


def test_a_pe_says_what_it_is(master: Master) -> None:
    assert master.sdo[0x1000].raw == 0
    assert [number.raw for number in master.sdo[0x1018].values()] == [0, 0x5045, 1, 0]
    assert master.sdo["Manufacturer device name"].raw == "heronry PE"
    assert master.sdo[0x1014].raw == 128 + NODE
    assert [identifier.raw for identifier in master.sdo[0x1200].values()] == [0x600 + NODE, 0x580 + NODE]
    assert [text.raw for text in master.sdo["Spec of this PE"].values()] == [
        *("tail", "small", "00" * 32, PROTOCOL.number)
    ]
    assert master.sdo["Table of this PE"].raw == TABLE.to_json().encode()
    assert master.sdo["Store EDS"].raw == eds_text().encode()


def test_it_tells_its_modules_and_what_each_does(master: Master) -> None:
    assert [name.raw for name in master.sdo["Module name"].values()] == ["control", "servo_1", "servo_2", "monitor"]
    assert [index.raw for index in master.sdo["Module index"].values()] == [CONTROL, SERVO_1, SERVO_2, MONITOR]
    assert [image.raw for image in master.sdo["Module image"].values()] == ["control", "servo", "servo", "monitor"]

    def doing() -> list[tuple[int, str]]:
        states, modes = master.sdo["Module state"].values(), master.sdo["Module mode"].values()
        return [(state.raw, mode.raw) for state, mode in zip(states, modes, strict=True)]

    assert doing() == [(0, "")] * 4
    master.pe.configure(FLYING, 7, Step.BREAK)
    assert doing() == [(4, ""), (2, ""), (0, ""), (0, "")]
    master.pe.configure(FLYING, 7, Step.GO)
    assert doing() == [(1, "full"), (2, ""), (0, ""), (0, "")]
    master.pe.configure(FLYING, 7, Step.GO_ALL)
    assert doing() == [(1, "full"), (1, "only"), (0, ""), (0, "")]
    master.pe.give(StartFailed(CONTROL, "oops"))
    assert doing() == [(3, ""), (1, "only"), (0, ""), (0, "")]
    assert refusal(lambda: master.sdo["Module name"][5].raw) == 0x0800_0024


def test_it_keeps_why_each_module_failed_last(master: Master) -> None:
    """A text from a module is made plain; it stays when the fault is cleared, for a reader that comes late."""

    def told(kind: str) -> list[str | bytes]:
        return [text.raw for text in master.sdo[f"Module {kind}"].values()]

    assert told("failure") == [""] * 4
    master.pe.configure(FLYING, 7)
    failure = StartFailed(CONTROL, "ValueError: \x1b[2J\u00e9 (my.py:3)", "Traceback\n  File my.py\nValueError: \x07\n")
    master.pe.give(failure)
    assert told("failure") == ["ValueError: \\x1b[2J\\xe9 (my.py:3)", "", "", ""]
    assert told("traceback")[0] == b"Traceback\n  File my.py\nValueError: \\x07"
    master.pe.core.modules.cleared(2, CONTROL)
    assert told("failure")[0] == "ValueError: \\x1b[2J\\xe9 (my.py:3)"


def test_code_that_cannot_be_imported_is_the_failure_of_its_modules(master: Master) -> None:
    actions = master.pe.give(ImagesMissing({"servo": "no module named 'servo'", "nobody's": "\n"}))
    assert [text.raw for text in master.sdo["Module failure"].values()] == ["", *["no module named 'servo'"] * 2, ""]
    assert "servo cannot be run here: no module named 'servo'" in [
        action.text for action in actions if isinstance(action, Note)
    ]


def test_it_counts_the_standstills_of_its_computer(master: Master) -> None:
    """One longer than a period is noted, but not each of many; one longer than all before it is."""
    notes = []
    for for_ms in (6, 140, 60, 150):
        notes += [a.text for a in master.pe.give(StoodStill(for_ms * MS)) if isinstance(a, Note) and a.kind == "late"]
    assert notes == ["this computer stood still for 140 ms", "this computer stood still for 150 ms"]
    master.pe.pass_time(SECOND)
    master.pe.give(StoodStill(30 * MS))
    assert [counter.raw for counter in master.sdo["Counters"].values()][2:] == [5, 4, 30, 150]


def test_what_it_costs_its_computer_is_an_object_once_it_is_known() -> None:
    known: list[NodeCost] = []
    pe = OnePe()
    pe.core = AgentCore(TABLE, 5, pe.now_ns, cost=lambda: known[-1] if known else None)
    pe.pass_time(1 * MS)
    cost = Master(pe).sdo["Cost of this node in the last 10 s"].values()
    assert {element.raw for element in cost} == {0xFFFF_FFFF}
    known.append(NodeCost(wake_ups_per_s=310, agent_per_mille=74, modules_per_mille=15, longest_turn_us=2_350))
    assert [element.raw for element in cost] == [310, 74, 15, 2_350]


def test_its_state_is_that_of_its_state_frames(master: Master) -> None:
    def state() -> list[int]:
        return [number.raw for number in master.sdo["State of this PE"].values()]

    assert state() == [0, 0, 5, 0, 0, 0, 0, 0, 0, 0]
    assert [number.raw for number in master.sdo["Manager that is obeyed"].values()] == [0, 0, 0]
    master.pe.configure(FLYING, 7)
    master.pe.command(Lease(1, 7, Step.GO_ALL, 1007))
    page_0, page_1 = master.pe.ask()
    running = master.pe.core.active_configuration.running
    assert state() == [
        *(PeState.ACTIVE, page_0.flags, 5, 7, 1007, running.slice_digest, 7, 1007),
        *(page_1.reason, page_1.load),
    ]
    assert [number.raw for number in master.sdo["Manager that is obeyed"].values()] == [MANAGER, 1, 1]


def test_faults_are_in_the_error_register_and_its_history(master: Master) -> None:
    assert master.sdo[0x1001].raw == 0
    master.pe.configure(FLYING, 7)
    for module in (CONTROL, SERVO_1):
        master.pe.give(StartFailed(module, "oops"))
    master.pe.pass_time(SECOND)  # reported again and again, and recorded once
    assert master.sdo[0x1001].raw == 0x81
    assert [error.raw for error in master.sdo[0x1003].values()] == [
        2 << 28 | module << 16 | FaultCode.MODULE_EXCEPTION for module in (SERVO_1, CONTROL)
    ]
    assert refusal(lambda: master.sdo[0x1003][3].raw) == 0x0800_0024
    assert refusal(lambda: setattr(master.sdo[0x1003][0], "raw", 2)) == 0x0609_0030
    assert refusal(lambda: setattr(master.sdo[0x1003][1], "raw", 0)) == 0x0601_0002
    master.sdo[0x1003][0].raw = 0
    assert master.sdo[0x1003][0].raw == 0
    assert master.sdo[0x1001].raw == 0x81


def test_the_heartbeat_time_can_be_set(master: Master) -> None:
    heartbeat = master.sdo["Producer heartbeat time"]
    assert heartbeat.raw == 1000
    heartbeat.raw = 200
    assert heartbeat.raw == 200
    assert master.heartbeats(master.pe.pass_time(SECOND)) == [PRE_OPERATIONAL] * 5
    heartbeat.raw = 0
    assert master.heartbeats(master.pe.pass_time(5 * SECOND)) == []
    assert refusal(lambda: setattr(heartbeat, "raw", 99)) == 0x0609_0030
    assert refusal(lambda: master.sdo.download(0x1017, 0, b"\1\2\3")) == 0x0607_0010
    assert refusal(lambda: master.sdo.download(0x1017, 0, bytes(9))) == 0x0607_0010
    assert heartbeat.raw == 0
    heartbeat.raw = 100
    assert len(master.heartbeats(master.pe.pass_time(SECOND))) == 10


def test_code_is_not_taken_by_sdo_and_says_so(master: Master) -> None:
    program, control = master.sdo[0x1F50][1], master.sdo[0x1F51][1]
    assert refusal(lambda: program.raw) == 0x0601_0001
    assert refusal(lambda: setattr(program, "raw", b"a program")) == 0x0601_0000
    assert refusal(lambda: setattr(control, "raw", 0)) == 0x0601_0000
    assert control.raw == 1


def test_a_table_is_taken_only_if_it_is_the_one_that_is_there(master: Master) -> None:
    table = master.sdo["Table of this PE"]
    same = TABLE.to_json().encode() + b"\n"
    with table.open("wb", size=len(same), block_transfer=True, buffering=7) as stream:
        stream.write(same)
    assert refusal(lambda: setattr(table, "raw", GATEWAY_TABLE.to_json().encode())) == 0x0800_0022
    assert refusal(lambda: table.open("wb", size=2**20 + 1, block_transfer=True)) == 0x0504_0005
    with table.open("rb", block_transfer=True) as stream:
        assert stream.read() == TABLE.to_json().encode()


def test_what_a_flying_pe_sends_is_the_same_while_it_is_read() -> None:
    """State frames, data and echoes go out at the same instants, whatever a client fetches."""

    def flown(*, read: bool) -> list[tuple[int, Send]]:
        pe = OnePe()
        pe.outputs[CONTROL] = {"demand": 1.0}
        pe.configure(FLYING, 7)
        pe.fly(100 * MS, epoch=7, digest=1007)
        request_id, answer_id = sdo_request_id(NODE), sdo_response_id(NODE)
        if read:
            pe.hear(Frame(request_id, bytes.fromhex("a420200020000000")))
            pe.hear(Frame(request_id, bytes.fromhex("a300000000000000")))
        pe.done.clear()
        pe.fly(200 * MS, epoch=7, digest=1007)
        sends = [(at_ns, action) for at_ns, action in pe.done if isinstance(action, Send)]
        answers = [at_ns for at_ns, send in sends if send.frame.can_id == answer_id]
        assert len(answers) == (32 if read else 0)
        assert len(set(answers)) == len(answers)  # one at a time
        return [(at_ns, send) for at_ns, send in sends if send.frame.can_id != answer_id]

    quiet = flown(read=False)
    assert {DEMAND_ID, state_id(NODE)} <= {send.frame.can_id for _, send in quiet}
    assert flown(read=True) == quiet


# NMT


def test_a_stopped_pe_answers_no_sdo_until_a_manager_speaks(master: Master) -> None:
    master.nmt(STOP)
    with pytest.raises(SdoCommunicationError):
        master.sdo.upload(0x1000, 0)
    assert pages(master.pe.pass_time(100 * MS)), "its state frames go on"
    master.pe.command(Lease(1, 0, Step.PREPARED, 0))
    assert master.sdo[0x1000].raw == 0
    assert master.heartbeats(master.pe.pass_time(SECOND)) == [PRE_OPERATIONAL]


@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
def test_a_reset_says_boot_up_and_forgets_what_canopen_has_set(master: Master, command: int) -> None:
    master.sdo[0x1017].raw = 0
    master.pe.pass_time(SECOND)
    master.nmt(STOP)
    incarnation = master.pe.ask()[0].incarnation
    assert master.heartbeats(master.nmt(command) + master.pe.pass_time(SECOND - 1)) == [BOOT_UP]
    assert master.heartbeats(master.pe.pass_time(SECOND)) == [PRE_OPERATIONAL]
    assert master.sdo[0x1017].raw == 1000
    assert master.pe.ask()[0].incarnation == incarnation


def test_a_flood_of_resets_is_answered_ten_times_a_second(master: Master) -> None:
    actions: list[Action] = []
    for _ in range(1_000):
        actions += master.nmt(RESET_NODE, 0) + master.pe.pass_time(1 * MS)
    assert len(master.heartbeats(actions)) <= 11


@pytest.mark.parametrize("command", [START, STOP, ENTER_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION])
def test_nmt_takes_no_surface_away(master: Master, command: int) -> None:
    pe = master.pe
    pe.configure(FLYING, 7)
    pe.fly(100 * MS, epoch=7, digest=1007)
    for node in (0, NODE):
        assert master.nmt(command, node) == []
    flown = pe.fly(SECOND, epoch=7, digest=1007)
    assert master.heartbeats(flown) == [OPERATIONAL]
    assert len(pe.steps[SERVO_1]) >= 40
    assert pe.ask()[0].state is PeState.ACTIVE
    assert pe.core.counts["NMT command while this PE is configured or hears a manager", 0] == 2
    pe.pass_time(SECOND)  # the manager is gone, and its configuration goes on
    assert master.nmt(command) == []
    assert sorted(pe.running) == [CONTROL, SERVO_1]


# CANaerospace node services


def test_a_heartbeat_that_is_set_before_boot_up_begins_after_it() -> None:
    network = NetworkManagement(NODE, (0,), 0)
    network.set_heartbeat(SHORTEST_HEARTBEAT_MS, 0)
    (boot_up,) = network.tick(0, configured=False, managed=False)
    assert boot_up.frame.data == b"\0"
    assert network.next_ns == SHORTEST_HEARTBEAT_MS * MS
