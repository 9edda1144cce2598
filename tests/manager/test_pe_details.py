"""What a manager reads from PEs by SDO for people: why modules failed, tracebacks, standstills of computers."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from heronry_manager import events
from heronry_manager.core.sdo_client.object_reader import SILENCE_NS
from heronry_manager.core.vocabulary import AskStatus, AskTraceback, ClearElement, ManagerAction, OperatorSaid, Reply
from heronry_wire.canopen_objects import COST, COUNTERS, MODULE_FAILURES, MODULE_TRACEBACKS, SPEC
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id, sdo_request_id, sdo_response_id, state_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.node_cost import WINDOW_NS
from heronry_wire.protocol_times import FORGIVEN_AFTER_NS
from heronry_wire.protocol_version import PROTOCOL, Version
from heronry_wire.sansio import Send
from heronry_wire.sdo import LAST_SEGMENT, SIZE_GIVEN, TOGGLE, UPLOAD, UPLOAD_ANSWER, with_data, with_number
from heronry_wire.standstill import StoodStill
from heronry_wire.state_frames import PeState, Reason, StatePage1
from lab.peers import PlayedObjects
from manager.one_manager import MS, E, OneManager, two_tails

LEFT = 92
CONTROL, DRIVE_LEFT = 0, 1  # indices in the spec
TEXT = "ValueError: no such angle (control.py:12)"


class Reading(OneManager):
    """A manager that reads objects, which played PEs answer unless their reception has failed."""

    def __init__(self) -> None:
        super().__init__(reads_objects=True)
        self.played = PlayedObjects()
        self.objects, self.asked = self.played.values, self.played.asked
        self.replies: list[Reply] = []
        self.spoil: Callable[[bytes], bytes] = lambda answer: answer
        self.is_deaf = False

    def give(self, event: Any) -> list[ManagerAction]:
        actions = super().give(event)
        self.replies += [action for action in actions if isinstance(action, Reply)]
        for action in actions:
            if isinstance(action, Send) and 0x600 < action.frame.can_id < 0x680 and not self.is_deaf:
                self._answer(action.frame)
        return actions

    def _answer(self, frame: Frame) -> None:
        node = frame.can_id - 0x600
        self.now_ns += MS
        self.hear(Frame(sdo_response_id(node), self.spoil(self.played.answer(node, frame.data))))

    def emcy(self, code: FaultCode, module: int, detail: int = 0) -> None:
        self.hear(Frame(emcy_id(LEFT), Emergency(code, 0x81, ElementKind.MODULE, module, detail).encode()))

    def told(self, kind: type[E]) -> list[E]:
        """Return the events of a kind, each with time 0."""
        return [replace(one, t_ns=0) for one in self.of(kind)]

    def ask(self, order: AskStatus | AskTraceback) -> Reply:
        self.give(OperatorSaid(1, order))
        return self.replies[-1]

    def status(self) -> dict[str, Any]:
        found = self.ask(AskStatus()).status
        assert found is not None
        return dict(found)

    def is_silent_for_two_beats(self, pe: str) -> None:
        """Let a PE miss beats, so that it is suspected, and answer."""
        running = self.running.pop(pe)
        self.pass_time(45 * MS)
        self.running[pe] = running
        self.beat(pe)

    def costs(self, *numbers: int) -> None:
        for sub_index, number in enumerate(numbers, start=1):
            self.objects[LEFT, COST, sub_index] = number.to_bytes(4, "little")

    def counters(self, long_times: int, last_long_ms: int) -> None:
        for sub_index, number in enumerate((30, long_times, last_long_ms, 200), start=3):
            self.objects[LEFT, COUNTERS, sub_index] = number.to_bytes(4, "little")


@pytest.fixture
def manager() -> Reading:
    flying = Reading()
    flying.start()
    flying.asked.clear()
    return flying


def test_why_a_module_failed_is_told_once_and_shown_in_the_status(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    began_ns = manager.now_ns
    for _ in range(3):
        manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 1)
    told = {"element": "module:control", "by": "left", "text": TEXT}
    assert manager.told(events.ModuleFailed) == [events.ModuleFailed(0, **told, heard_ns=began_ns)]
    manager.pass_time(30 * MS)
    (kept,) = manager.status()["failures"]
    assert {key: kept[key] for key in told} == told
    assert kept["for_ns"] >= 30 * MS
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 2)
    assert [one.text for one in manager.told(events.ModuleFailed)] == [TEXT] * 2


def failure(manager: Reading) -> tuple[str, bool]:
    """The one module that has failed, and whether it is mended."""
    (kept,) = manager.status()["failures"]
    return kept["element"], kept["is_over"]


def test_a_failure_is_over_when_its_fault_is_cleared_and_stays_known(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.emcy(FaultCode.MODULE_EXCEPTION, CONTROL)
    assert [fault["element"] for fault in manager.status()["latched"]] == ["module:control@left"]
    manager.pass_time(2 * FORGIVEN_AFTER_NS)
    assert failure(manager) == ("module:control", False)
    manager.give(OperatorSaid(1, ClearElement("module:control@left")))
    assert failure(manager) == ("module:control", True)


def test_a_restart_is_forgiven_after_a_minute_without_another(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 1)
    manager.pass_time(FORGIVEN_AFTER_NS // 2)
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 2)
    manager.pass_time(FORGIVEN_AFTER_NS * 3 // 4)
    assert failure(manager) == ("module:control", False)
    manager.pass_time(FORGIVEN_AFTER_NS // 2)
    assert failure(manager) == ("module:control", True)


def test_a_hostile_text_is_made_plain(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 2] = b"\x1b[2J\xff" + b"x" * 400
    manager.emcy(FaultCode.MODULE_EXCEPTION, DRIVE_LEFT)
    (told,) = manager.told(events.ModuleFailed)
    assert told.text.startswith("\\x1b[2J")
    assert len(told.text) == 200


@pytest.mark.parametrize(
    "spoil",
    [
        lambda answer: answer[:5],
        lambda answer: bytes((answer[0] ^ TOGGLE,)) + answer[1:],
        lambda answer: bytes((0x80,)) + answer[1:],
        lambda _: with_number(UPLOAD_ANSWER | SIZE_GIVEN, MODULE_FAILURES, 1, 1 << 20),
        lambda _: with_number(UPLOAD_ANSWER | SIZE_GIVEN, MODULE_FAILURES, 2, 5),
        lambda answer: with_number(UPLOAD_ANSWER | SIZE_GIVEN, MODULE_FAILURES, 1, 3) if answer[0] == 0x41 else answer,
        lambda answer: bytes((answer[0] | LAST_SEGMENT,)) + answer[1:],
    ],
)
def test_a_wrong_answer_gives_no_text_and_the_next_reading_works(
    manager: Reading, spoil: Callable[[bytes], bytes]
) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.spoil = spoil
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 1)
    assert manager.told(events.ModuleFailed) == []
    manager.spoil = lambda answer: answer
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 2)
    assert len(manager.told(events.ModuleFailed)) == 1


def test_a_pe_that_does_not_answer_is_given_up_and_the_next_object_is_read(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 2] = TEXT.encode()
    manager.is_deaf = True
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 1)
    manager.emcy(FaultCode.MODULE_RESTARTED, DRIVE_LEFT, 1)
    manager.pass_time(SILENCE_NS - 10 * MS)
    manager.is_deaf = False
    manager.pass_time(20 * MS)
    assert [one.element for one in manager.told(events.ModuleFailed)] == ["module:drive_left"]


def test_a_busy_pe_is_asked_up_to_three_times_why_a_module_has_failed(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.is_deaf = True
    manager.emcy(FaultCode.MODULE_EXCEPTION, CONTROL)
    manager.pass_time(3 * SILENCE_NS)
    manager.is_deaf = False
    assert manager.told(events.ModuleFailed) == []
    manager.pass_time(2 * SILENCE_NS)
    assert [one.text for one in manager.told(events.ModuleFailed)] == [TEXT]


def test_a_pe_that_never_says_why_a_module_has_failed_is_asked_three_times(manager: Reading) -> None:
    manager.emcy(FaultCode.MODULE_EXCEPTION, CONTROL)
    manager.pass_time(10 * SILENCE_NS)
    assert [one for one in manager.asked if one[1] == MODULE_FAILURES] == [(LEFT, MODULE_FAILURES, 1)] * 3


def test_a_pe_that_another_sdo_client_asks_is_read_after_that(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.hear(Frame(sdo_request_id(LEFT), bytes(8)))
    assert manager.core.hears(sdo_request_id(LEFT))
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 1)
    assert manager.told(events.ModuleFailed) == []
    manager.pass_time(SILENCE_NS + 10 * MS)
    assert len(manager.told(events.ModuleFailed)) == 1


def test_the_traceback_comes_when_the_operator_asks(manager: Reading) -> None:
    element = AskTraceback("module:control")
    assert manager.ask(element).sentence == (
        "no failure of module:control is known to this manager: no module has failed"
    )
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.emcy(FaultCode.MODULE_EXCEPTION, CONTROL)
    assert "left does not give the traceback" in manager.ask(AskTraceback("module:control@left")).sentence
    assert manager.ask(AskTraceback("module:drive_left")).sentence == (
        "no failure of module:drive_left is known to this manager: the known failures are those of module:control"
    )
    unknown = manager.ask(element)
    assert (unknown.done, unknown.sentence) == (
        False,
        "left does not give the traceback of module:control: look into the log of its agent",
    )
    manager.objects[LEFT, MODULE_TRACEBACKS, 1] = b""
    assert manager.ask(element).sentence == (
        f"left has no traceback of module:control: no exception was raised ({TEXT})"
    )
    manager.objects[LEFT, MODULE_TRACEBACKS, 1] = b"Traceback:\n  File x\nValueError: \x07"
    answer = manager.ask(element)
    assert (answer.done, answer.sentence) == (True, "Traceback:\n  File x\nValueError: \\x07")


def test_what_has_no_traceback_is_said_at_once_and_no_pe_is_asked(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.emcy(FaultCode.MODULE_EXCEPTION, CONTROL)
    manager.asked.clear()
    pe, unknown = (manager.ask(AskTraceback(element)) for element in ("pe:left", "module:contrl"))
    assert pe == Reply(1, done=False, sentence="pe:left has no code that could fail: name a module", is_unusable=True)
    assert (unknown.done, unknown.is_unusable) == (False, True)
    assert unknown.sentence == "no module is named 'contrl'; did you mean 'control'?"
    assert manager.asked == []


def test_a_manager_that_is_no_longer_active_gives_up_what_it_reads(manager: Reading) -> None:
    manager.objects[LEFT, MODULE_FAILURES, 1] = TEXT.encode()
    manager.emcy(FaultCode.MODULE_EXCEPTION, CONTROL)
    manager.is_deaf = True
    for number in range(80):  # more than can wait
        manager.give(OperatorSaid(number, AskTraceback("module:control")))
    assert len(manager.replies) == 80 - 65
    for pe in ("left", "middle", "right"):
        manager.die(pe)
    manager.pass_time(500 * MS)
    assert len(manager.replies) == 80
    assert not any(reply.done for reply in manager.replies)


def test_a_late_answer_of_another_node_or_none_at_all_is_dropped(manager: Reading) -> None:
    manager.hear(Frame(sdo_response_id(LEFT), bytes(8)))
    manager.is_deaf = True
    manager.emcy(FaultCode.MODULE_RESTARTED, CONTROL, 1)
    manager.hear(Frame(sdo_response_id(93), bytes(8)))
    manager.is_deaf = False
    manager.objects[LEFT, MODULE_FAILURES, 1] = b"no"
    manager.hear(Frame(sdo_response_id(LEFT), manager.played.answer(LEFT, with_data(UPLOAD, MODULE_FAILURES, 1))))
    assert [one.text for one in manager.told(events.ModuleFailed)] == ["no"]


def test_a_standstill_of_a_pe_is_told_when_it_was_not_heard(manager: Reading) -> None:
    """A status that was asked for before does not hide it: here the status has read the counters already."""
    manager.counters(3, 90)
    assert manager.status()["pes"]["left"]["standstills"] is None
    counted = {"times": 30, "long_times": 3, "last_long_ms": 90, "longest_ms": 200}
    assert manager.status()["pes"]["left"]["standstills"] == counted
    assert manager.told(events.StoodStill) == []
    manager.pass_time(100 * MS)
    manager.is_silent_for_two_beats("left")
    assert manager.told(events.StoodStill) == [events.StoodStill(0, by="left", for_ns=200 * MS, times=3)]
    manager.counters(4, 140)
    manager.pass_time(100 * MS)
    manager.is_silent_for_two_beats("left")
    assert manager.told(events.StoodStill)[1:] == [events.StoodStill(0, by="left", for_ns=140 * MS, times=4)]


def test_the_status_shows_what_a_pe_costs_and_reads_it_once_per_window(manager: Reading) -> None:
    manager.costs(310, 74, 15, 2_350)
    assert manager.status()["pes"]["left"]["cost"] is None
    first = {"wake_ups_per_s": 310, "agent_per_mille": 74, "modules_per_mille": 15, "longest_turn_us": 2_350}
    manager.costs(1, 1, 1, 1)
    assert manager.status()["pes"]["left"]["cost"] == first
    assert manager.status()["pes"]["left"]["cost"] == first
    manager.pass_time(WINDOW_NS)
    manager.status()
    assert manager.status()["pes"]["left"]["cost"] == dict.fromkeys(first, 1)
    assert manager.status()["pes"]["right"]["cost"] is None


def test_a_cost_that_the_pe_has_not_measured_yet_is_read_again_with_the_next_status(manager: Reading) -> None:
    manager.costs(*[0xFFFF_FFFF] * 4)
    for _ in range(2):
        assert manager.status()["pes"]["left"]["cost"] is None
    manager.costs(2, 2, 2, 2)
    manager.status()
    assert set(manager.status()["pes"]["left"]["cost"].values()) == {2}


@pytest.mark.parametrize("length", [0, 5, 8])
def test_an_answer_that_is_no_number_is_none(manager: Reading, length: int) -> None:
    value = b"\xff" * length
    manager.objects |= {(LEFT, index, sub_index): value for index in (COST, COUNTERS) for sub_index in range(1, 7)}
    manager.status()
    manager.is_silent_for_two_beats("left")
    left = manager.status()["pes"]["left"]
    assert (left["cost"], left["standstills"]) == (None, None)
    assert not manager.told(events.StoodStill)
    manager.objects |= {(LEFT, SPEC, 3): b"ab", (LEFT, SPEC, 4): value}
    page = StatePage1(PeState.ACTIVE, manager.flags, manager.running["left"].epoch, 0, Reason.DIGEST, 0)
    manager.hear(Frame(state_id(LEFT), page.encode()))
    assert manager.last(events.AnotherTable).why.startswith("its table is another one")


def test_the_longest_standstill_is_told_if_the_pe_never_had_a_longer_one(manager: Reading) -> None:
    manager.counters(2, 30)
    manager.is_silent_for_two_beats("left")
    assert manager.told(events.StoodStill) == [events.StoodStill(0, by="left", for_ns=200 * MS, times=2)]


def test_a_pe_that_has_restarted_counts_anew(manager: Reading) -> None:
    for times, expected in ((9, 1), (9, 1), (0, 1), (2, 2), (1, 3)):
        manager.counters(times, 50)
        manager.is_silent_for_two_beats("left")
        assert len(manager.told(events.StoodStill)) == expected


def test_a_standstill_of_the_managers_own_computer_is_told_and_counted(manager: Reading) -> None:
    for for_ms in (6, 140, 30):
        manager.give(StoodStill(for_ms * MS))
    assert manager.told(events.StoodStill) == [events.StoodStill(0, by="manager 126", for_ns=140 * MS, times=1)]
    counted = {"times": 3, "long_times": 2, "last_long_ms": 30, "longest_ms": 140}
    assert manager.status()["manager"]["standstills"] == counted


def test_a_module_that_is_not_in_the_table_of_the_pe_is_not_asked_for(manager: Reading) -> None:
    manager.emcy(FaultCode.MODULE_EXCEPTION, 2)  # drive_right is bolted to another PE
    assert [one for one in manager.asked if one[1] == MODULE_FAILURES] == []


def test_by_default_nothing_is_read() -> None:
    manager = OneManager()
    manager.start()
    manager.hear(Frame(emcy_id(LEFT), Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, 0, 0).encode()))
    assert [frame for frame in manager.frames if 0x600 < frame.can_id < 0x680] == []
    assert not manager.core.hears(sdo_response_id(LEFT))
    assert Reading().core.hears(sdo_response_id(LEFT))


def refuses(manager: Reading, version: Version, digest: str) -> list[str]:
    """Let `left` refuse its slice for its digest; returns why it stages nothing, as often as that is told."""
    manager.objects[LEFT, SPEC, 3] = digest.encode()
    manager.objects[LEFT, SPEC, 4] = version.number.to_bytes(4, "little")
    epoch = manager.running["left"].epoch
    page = StatePage1(PeState.ACTIVE, manager.flags, epoch, 0, Reason.DIGEST, 0)
    manager.hear(Frame(state_id(LEFT), page.encode()))
    return [one.why for one in manager.events if isinstance(one, events.AnotherTable) and one.pe == "left"]


@pytest.mark.parametrize(
    ("version", "digest", "says"),
    [
        (Version(PROTOCOL.major + 1, 3), "", f"it speaks protocol {PROTOCOL.major + 1}.3, and this manager {PROTOCOL}"),
        (PROTOCOL, "ab" * 32, "its table is of another spec (abababababab): write it anew"),
        (Version(PROTOCOL.major, 9), two_tails().digest, "its table was compiled otherwise, or damaged in memory"),
    ],
)
def test_why_a_pe_stages_nothing_is_told_once(manager: Reading, version: Version, digest: str, says: str) -> None:
    (why,) = refuses(manager, version, digest)
    assert says in why
    assert refuses(manager, version, digest) == [why]


def test_of_a_pe_that_does_not_answer_it_is_told_what_its_refusal_shows(manager: Reading) -> None:
    manager.is_deaf = True
    assert refuses(manager, PROTOCOL, "") == []
    manager.pass_time(3 * SILENCE_NS)
    (told,) = [one for one in manager.events if isinstance(one, events.AnotherTable)]
    assert told.why.startswith("its table is another one than this manager compiles for it: write it anew")
