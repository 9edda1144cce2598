"""A manager brings a PE the code that it lacks: every message between them lost, doubled, late or damaged.

The PE has the real SDO server and the real door of its loader; the loader itself takes what is whole. What must hold
whatever happens: the PE runs no code or exactly the bundle; in the end it runs it, and the fault is cleared once; no
other PE is lost.
"""

from collections.abc import Callable, Collection
from dataclasses import replace
from hashlib import sha256

import pytest

from heronry_agent.core.canopen import Programs, SdoServer
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import ControlProgram, ProgramState, WriteProgram
from heronry_manager import events
from heronry_manager.core.provisioning import code_bringing
from heronry_manager.core.provisioning.pace import Pace
from heronry_manager.core.settings import CodeBundle
from heronry_manager.core.vocabulary import AskStatus, ClearElement, FailElement, RestoreElement, RetireElement
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.canopen_objects import (
    MODULE_FAILURES,
    PROGRAM_CONTROL,
    PROGRAM_STATUS,
    PROGRAM_TRANSFER,
    PROGRAM_VERSION,
)
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id
from heronry_wire.management import Control, ElementKind, Emergency, FaultCode, Operation
from heronry_wire.sdo import ABORT, UPLOAD, Abort, abort_message, with_data
from lab.peers import PlayedObjects
from manager.messages_on_the_way import Change, Exchange, changes
from manager.one_manager import MS, OneManager, two_tails
from manager.test_operator import say
from manager.test_table_pace import deploy
from thoroughness import IS_WHOLE

PE, NODE, MODULE = "middle", 93, "control"
REQUEST, ANSWER = sdo_request_id(NODE), sdo_response_id(NODE)
IMAGE = "state_estimator"
PART_BYTES = 700  # a tenth of what is sent in flight: the steps are the same, in a tenth of the messages
CONTENT = bytes(range(251)) * 4  # two parts
BUNDLE = CodeBundle("nav", 3, frozenset((IMAGE,)), CONTENT)
LACK = Emergency(FaultCode.MODULE_MISSING, 0x81, ElementKind.MODULE, 0, 0)
WORK_NS = 700 * MS
LONGEST_NS = 60_000 * MS

CHANGES = changes(PROGRAM_TRANSFER, 1)


class Pe:
    """The SDO server of a PE with a loader that needs a while for each order; it takes CONTENT, and runs it when told.

    error: what the loader answers to each bundle; 0: it takes it.
    """

    def __init__(self, now_ns: int, error: int = 0) -> None:
        self.turn, self.error = Turn(now_ns), error
        self.programs = Programs(self.turn, ProgramState())
        self.server = SdoServer(self, MS)
        self.ready: bytes | None = None
        self.version = 0
        self.works: tuple[int, object] | None = None
        self.never_ends = self.never_starts = False

    def room(self, index: int, *_: object) -> int | Abort:
        if not self.programs.takes_bytes():
            return Abort.DEVICE_STATE
        return 1 if index == PROGRAM_CONTROL else 1 << 20

    def write(self, index: int, sub_index: int, data: bytes) -> Abort | None:
        assert sub_index == 1
        return self.programs.write_part(data) if index == PROGRAM_TRANSFER else self.programs.order(data[0])

    def read(self, index: int, sub_index: int) -> bytes | Abort:
        values: dict[tuple[int, int], bytes] = {
            (PROGRAM_VERSION, 1): self.programs.version.to_bytes(4, "little"),
            (PROGRAM_STATUS, 1): self.programs.status.to_bytes(4, "little"),
            (PROGRAM_TRANSFER, 2): self.programs.received,
            (PROGRAM_TRANSFER, 3): self.programs.active,
        }
        return values.get((index, sub_index), Abort.NO_OBJECT)

    def hear(self, data: bytes, now_ns: int) -> list[bytes]:
        self.turn.begin(now_ns)
        answer = self.server.request(data, now_ns)
        self._work(now_ns)
        return [] if answer is None else [answer]

    def tick(self, now_ns: int) -> list[bytes]:
        self.turn.begin(now_ns)
        if self.works is not None and now_ns >= self.works[0] and not self.never_ends:
            self._done(self.works[1])
        answer = self.server.tick(now_ns) if now_ns >= self.server.next_ns else None
        return [] if answer is None else [answer]

    def _work(self, now_ns: int) -> None:
        for action in self.turn.end():
            if isinstance(action, WriteProgram | ControlProgram):
                assert self.works is None
                self.works = now_ns + WORK_NS, action

    def _done(self, action: object) -> None:
        self.works = None
        if isinstance(action, WriteProgram):
            assert action.content == CONTENT, "a bundle is whole, or it does not come"
            self.ready = action.content if not self.error else None
            self.programs.changed(ProgramState(self.version, self.error))
            return
        if self.ready is not None and not self.never_starts:
            self.version = BUNDLE.version
        self.runs(self.version)

    def runs(self, version: int, content: bytes = CONTENT) -> None:
        """Let this code be in use."""
        self.version = version
        self.programs.changed(ProgramState(version, digest=sha256(content).digest() if version else b""))


class Flight(Exchange):
    """Three PEs that fly, one of which lacks code, and their manager."""

    def __init__(
        self, change: Change | None = None, at: int = -1, *, error: int = 0, lack: bool = True, **more
    ) -> None:
        manager = OneManager(**{"bundles": (BUNDLE,), **more})
        manager.start(fly=False)
        super().__init__(manager, NODE, change, at)
        self.pe = Pe(manager.now_ns, error)
        if lack:
            manager.report(PE, LACK)

    def fly(self, until: Callable[[], bool] = lambda: False, longest_ns: int = LONGEST_NS) -> bool:
        return super().fly(until, longest_ns)

    @property
    def identifiers(self) -> Collection[int]:
        return (REQUEST,)

    def due_ns(self, end_ns: int) -> int:
        works_ns = end_ns if self.pe.works is None or self.pe.never_ends else self.pe.works[0]
        return min(self.pe.server.next_ns, works_ns)

    def hear(self, frame: Frame) -> None:
        self._say(self.pe.hear(frame.data, self.manager.now_ns))

    def tick(self) -> None:
        self._say(self.pe.tick(self.manager.now_ns))

    def _say(self, answers: list[bytes]) -> None:
        for data in answers:
            self.pass_on(Frame(ANSWER, data))

    def has_come(self) -> bool:
        return bool(self.manager.of(events.CodeBrought))

    def judge(self) -> None:
        """The PE runs the bundle, the fault is cleared once, and no PE is lost."""
        assert self.fly(self.has_come), self.manager.of(events.CodeNotTaken)
        assert self.pe.version == BUNDLE.version
        (told,) = self.manager.of(events.CodeBrought)
        assert (told.pe, told.bundle, told.version, told.bytes) == (PE, "nav", 3, len(CONTENT))
        assert [one.element for one in self.manager.of(events.FaultCleared)] == [f"module:{MODULE}@{PE}"]
        assert not self.manager.of(events.PeLost)
        assert not self.manager.core.now.down


@pytest.fixture(autouse=True)
def short_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(code_bringing, "PART_BYTES", PART_BYTES)


def messages_of_a_transfer() -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(code_bringing, "PART_BYTES", PART_BYTES)
        flight = Flight()
        flight.judge()
        return flight.messages


MESSAGES = messages_of_a_transfer()
KEY = Key(b"k" * KEY_BYTES)


def test_code_comes_by_itself_in_a_tenth_of_the_bus_and_the_pe_is_told_of_the_cleared_fault() -> None:
    flight = Flight()
    flight.judge()
    (told,) = flight.manager.of(events.CodeBrought)
    assert told.took_ns >= len(CONTENT) // 7 * 10 * 135_000
    clears = [one for one in flight.manager.said(Control) if one.operation is Operation.CLEAR]
    assert len(clears) == 1
    assert not flight.manager.of(events.CodeNotTaken)
    assert flight.manager.core.status()["code"] == {}


@pytest.mark.parametrize("name", CHANGES)
def test_whatever_becomes_of_a_message_the_code_comes_whole(name: str) -> None:
    few = (1, MESSAGES // 3, MESSAGES - 6, MESSAGES - 1)
    for at in range(MESSAGES) if IS_WHOLE else few:
        Flight(CHANGES[name], at).judge()


@pytest.mark.parametrize("at", [0, 3, MESSAGES // 3, MESSAGES - 5, MESSAGES - 1])
def test_a_pe_whose_loader_restarts_is_brought_the_rest_or_all_of_it(at: int) -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > at)
    version = flight.pe.version
    flight.pe = Pe(flight.manager.now_ns)
    flight.pe.runs(version)
    assert flight.fly(flight.has_come)
    assert flight.pe.version == BUNDLE.version


def test_a_transfer_that_was_cut_off_goes_on_where_it_was() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.pe.programs.received[32:] != bytes(4))
    before = flight.messages
    flight.manager.hear(Frame(REQUEST, bytes(8)))  # another client
    flight.judge()
    assert flight.messages < MESSAGES + 20
    assert flight.messages - before < MESSAGES * 2 // 3
    assert not flight.manager.of(events.CodeNotTaken)


@pytest.mark.parametrize(("error", "why"), [(3, "it does not take it"), (5, "its disk"), (9, "it gives the error 9")])
def test_a_pe_that_cannot_take_it_is_told_once_and_tried_less_and_less(error: int, why: str) -> None:
    flight = Flight(error=error)
    assert not flight.fly(flight.has_come, 40_000 * MS)
    (told,) = flight.manager.of(events.CodeNotTaken)
    assert told.why.startswith(why)
    assert flight.manager.core.status()["code"][PE].startswith(why)
    assert f"module:{MODULE}@{PE}" in flight.manager.core.now.down
    tries = flight.messages // MESSAGES
    assert 2 <= tries <= 6


@pytest.mark.parametrize(("error", "why"), [(6, "it is too large"), (7, "it is not for this PE")])
def test_a_pe_that_refuses_it_is_told_once_and_tried_again_after_its_restart(error: int, why: str) -> None:
    flight = Flight(error=error)
    assert not flight.fly(flight.has_come, 40_000 * MS)
    (told,) = flight.manager.of(events.CodeNotTaken)
    assert told.why.startswith(why)
    assert flight.messages < MESSAGES
    flight.pe.error = 0
    flight.manager.reboot(PE)
    assert flight.fly(flight.has_come)


def test_a_pe_that_has_refused_it_is_tried_again_when_the_operator_has_cleared_the_fault() -> None:
    flight = Flight(error=7)
    assert not flight.fly(flight.has_come, 20_000 * MS)
    flight.pe.error = 0
    say(flight.manager, ClearElement(f"module:{MODULE}"))
    flight.manager.report(PE, LACK)  # at once, as a PE does
    assert flight.fly(flight.has_come)


def test_to_a_pe_with_a_newer_version_nothing_is_sent() -> None:
    flight = Flight()
    flight.pe.programs.changed(ProgramState(BUNDLE.version + 1))
    assert not flight.fly(flight.has_come, 40_000 * MS)
    (told,) = flight.manager.of(events.CodeNotTaken)
    assert told.why == "it has version 4 of its code: build nav with a higher one"
    assert flight.messages < 30


def test_a_bundle_without_all_of_the_code_of_a_pe_is_not_sent_and_this_is_told_once() -> None:
    other = replace(BUNDLE, name="tails", images=frozenset(("servo_driver_1",)))
    flight = Flight(bundles=(BUNDLE, other))
    flight.judge()  # nothing but `control` can run on the PE in the middle
    flight.manager.report("left", LACK)
    assert not flight.fly(lambda: len(flight.manager.of(events.CodeBrought)) > 1, 20_000 * MS)
    (told,) = flight.manager.of(events.CodeNotTaken)
    assert told.why == "no bundle holds all of its code: build one with servo_driver_1, state_estimator"


def test_after_an_arrival_the_pauses_are_short_again() -> None:
    flight = Flight(error=3)
    flight.fly(longest_ns=30_000 * MS)
    flight.pe.error = 0
    assert flight.fly(flight.has_come)
    flight.pe.error, flight.pe.version, before = 3, 0, flight.messages
    flight.pe.programs.changed(ProgramState(0))
    flight.manager.report(PE, LACK)
    assert not flight.fly(lambda: flight.messages - before > 2 * MESSAGES, 6_000 * MS)
    assert flight.fly(lambda: flight.messages - before > 2 * MESSAGES, 12_000 * MS)


def test_code_that_the_pe_has_and_does_not_run_is_no_arrival() -> None:
    flight = Flight()
    flight.pe.never_starts = True
    assert not flight.fly(flight.has_come, 20_000 * MS)
    assert flight.manager.of(events.CodeNotTaken)[0].why.startswith("it has taken the code, and does not use it")


def test_a_loader_that_never_ends_its_work_is_given_up() -> None:
    flight = Flight()
    flight.pe.never_ends = True
    assert not flight.fly(flight.has_come, 90_000 * MS)
    assert flight.manager.of(events.CodeNotTaken)[0].why == "its loader does not end its work"


def test_a_pe_without_an_sdo_server_is_told() -> None:
    flight = Flight(lambda _: [], 0)
    flight.manager.pass_time(30_000 * MS)
    assert [one.why for one in flight.manager.of(events.CodeNotTaken)] == ["it did not answer"]


@pytest.mark.parametrize("length", [0, 5, 8, 40, 4096])
def test_a_state_of_the_loader_that_is_no_number_is_none(length: int) -> None:
    flight, played = Flight(), PlayedObjects()
    looks = b"\x40\x57\x1f\x01"  # reads 1F57h sub 1
    assert flight.fly(lambda: flight.manager.frames[-1].data.startswith(looks))
    played.values[NODE, PROGRAM_STATUS, 1] = b"\3".ljust(length, b"\0")[:length]
    while not flight.manager.of(events.CodeNotTaken):
        asked = next(one for one in reversed(flight.manager.frames) if one.can_id == REQUEST)
        flight.manager.hear(Frame(ANSWER, played.answer(NODE, asked.data)))
    assert flight.manager.last(events.CodeNotTaken).why == "it did not answer"
    assert not flight.has_come()


def test_code_that_is_there_already_is_not_sent_again() -> None:
    flight = Flight()
    flight.pe.runs(BUNDLE.version)
    flight.judge()
    assert flight.messages < 20


def test_another_bundle_of_the_same_version_is_not_taken_for_this_one() -> None:
    flight = Flight()
    flight.pe.runs(BUNDLE.version, b"of somebody else")
    assert flight.fly(lambda: flight.manager.of(events.CodeNotTaken))
    assert "build nav with a higher one" in flight.manager.last(events.CodeNotTaken).why
    assert not flight.has_come()


def test_the_most_critical_code_and_the_bundle_that_holds_most_come_first() -> None:
    small = CodeBundle("small", 9, frozenset((IMAGE,)), b"small")
    flight = Flight(bundles=(small, replace(BUNDLE, images=frozenset((IMAGE, "other")))))
    flight.judge()


def test_a_bundle_that_is_larger_than_the_flash_is_not_sent() -> None:
    large = replace(BUNDLE, content=bytes(65 << 10))
    flight = Flight(bundles=(large,))
    assert not flight.fly(flight.has_come, 10_000 * MS)
    assert "more than its flash" in flight.manager.of(events.CodeNotTaken)[0].why
    assert flight.messages == 0


def test_nothing_is_brought_without_bundles_or_for_other_images() -> None:
    assert not Flight(bundles=()).fly(lambda: False, 10_000 * MS)
    flight = Flight(bundles=(replace(BUNDLE, images=frozenset(("another",))),))
    assert not flight.fly(lambda: flight.messages > 0, 10_000 * MS)
    assert not OneManager().core.hears(REQUEST)
    assert flight.manager.core.hears(REQUEST)


def test_no_code_is_brought_to_a_pe_that_is_lost_and_it_goes_on_when_it_is_back() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > MESSAGES // 2)
    page = flight.manager.running[PE]
    flight.manager.die(PE)
    assert not flight.fly(flight.has_come, 5_000 * MS)
    assert flight.manager.of(events.PeLost)
    flight.manager.running[PE] = page
    assert flight.fly(flight.has_come)


def test_a_manager_that_falls_silent_forgets_what_it_brings() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > MESSAGES // 2)
    for pe in list(flight.manager.running):
        flight.manager.die(pe)
    flight.manager.pass_time(3_000 * MS)
    assert not flight.manager.core.is_active
    assert flight.manager.core._code.status() == {}


@pytest.mark.parametrize("after", [0, MESSAGES // 2])
def test_a_bus_without_room_waits_and_says_so(after: int, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages >= after)
    with monkeypatch.context() as full:
        full.setattr(Pace, "period_ns", lambda _self, _node: None)
        assert not flight.fly(flight.has_come, 10_000 * MS)
    assert [one.why for one in flight.manager.of(events.CodeNotTaken)] == [
        "beside what runs the bus has no room for it"
    ]
    flight.judge()


def requests(flight: Flight) -> int:
    return sum(one.can_id == REQUEST for one in flight.manager.frames)


@pytest.mark.parametrize("after", [0, MESSAGES // 2])
def test_no_segment_is_sent_while_a_configuration_is_on_its_way(after: int, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages >= after)
    with monkeypatch.context() as held:
        held.setattr(Pace, "is_held", lambda _self: True)
        before = requests(flight)
        flight.fly(longest_ns=300 * MS)
        assert requests(flight) == before
    flight.judge()


def test_with_a_key_each_write_follows_an_unlock() -> None:
    manager = OneManager(key=KEY, bundles=(BUNDLE,))
    assert manager.core._code._client._key is KEY
    flight = Flight(spec=two_tails())
    client = flight.manager.core._code._client
    client._key = KEY  # the manager's other frames stay unproven, so that the test can play the PEs
    unlocks = lambda: [one for one in flight.manager.said(Control) if one.operation is Operation.UNLOCK]  # noqa: E731
    flight.judge()
    assert len(unlocks()) == 3  # two parts, and the start
    assert {(one.node, one.a) for one in unlocks()} == {(NODE, 5)}


def test_the_digest_is_that_of_the_bundle() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.pe.programs.received[32:] != bytes(4))
    assert flight.pe.programs.received[:32] == sha256(CONTENT).digest()


def test_what_is_on_its_way_is_shown() -> None:
    flight = Flight()
    shown = {PE: f"nav, version 3: {PART_BYTES} of {len(CONTENT)} bytes"}
    assert flight.fly(lambda: flight.manager.core.status()["code"] == shown)


def test_another_client_goes_first_while_the_pe_is_asked_too() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > 0)
    flight.manager.hear(Frame(ANSWER + 1, bytes(8)))
    flight.manager.hear(Frame(sdo_request_id(NODE + 1), bytes(8)))
    flight.manager.hear(Frame(REQUEST, bytes(8)))
    flight.judge()
    assert not flight.manager.of(events.CodeNotTaken)


def test_a_lack_that_the_operator_has_cleared_is_forgotten_and_other_lacks_stay() -> None:
    flight = Flight(error=7)
    flight.manager.report("left", replace(LACK, index=1))  # a module whose image is in no bundle
    flight.fly(lambda: bool(flight.manager.of(events.CodeNotTaken)))
    say(flight.manager, ClearElement(f"module:{MODULE}@{PE}"))
    flight.fly(longest_ns=2_000 * MS)
    assert flight.manager.core.status()["code"] == {}
    flight.pe.error = 0
    flight.manager.report(PE, LACK)
    assert flight.fly(flight.has_come)
    assert flight.manager.core.now.down == {"module:drive_left"}


WAITS = Frame(heartbeat_id(94), b"\x7f")  # `right` waits for its table


def to_right(flight: Flight) -> list[Frame]:
    return [one for one in flight.manager.frames if one.can_id == sdo_request_id(94)]


def test_no_table_is_brought_while_code_is() -> None:
    flight = Flight(brings_tables=True)
    flight.manager.die("right")
    assert flight.fly(lambda: flight.messages > 20)
    while not flight.has_come():
        flight.manager.hear(WAITS)
        flight.fly(flight.has_come, 300 * MS)
        assert not to_right(flight)
    flight.fly(longest_ns=900 * MS)
    flight.manager.hear(WAITS)
    flight.fly(longest_ns=200 * MS)
    assert to_right(flight)


def test_no_code_is_brought_while_a_table_is() -> None:
    flight = Flight(brings_tables=True)
    flight.manager.die("right")
    flight.fly(longest_ns=4_900 * MS)
    flight.manager.hear(WAITS)
    assert to_right(flight)
    flight.fly(longest_ns=900 * MS)
    assert flight.messages == 0
    assert flight.fly(lambda: flight.messages > 0, 800 * MS)


def test_a_status_in_every_moment_does_not_keep_code_away_and_what_is_read_waits_for_it() -> None:
    flight = Flight(reads_objects=True)
    reported = False
    while not flight.has_come():
        say(flight.manager, AskStatus())
        flight.fly(flight.has_come, 150 * MS)
        if flight.messages > MESSAGES // 3 and not reported:
            reported = True
            flight.manager.report(PE, replace(LACK, code=FaultCode.MODULE_EXCEPTION))
            before = len(flight.manager.frames)
        assert flight.manager.now_ns < LONGEST_NS
    assert not flight.manager.of(events.CodeNotTaken)
    assert reported

    def asks_why() -> bool:
        asked = with_data(UPLOAD, MODULE_FAILURES, 1)
        return Frame(REQUEST, asked) in flight.manager.frames[before:]

    assert not asks_why()
    assert flight.fly(asks_why, 90_000 * MS)  # the two other PEs, which are asked before, do not answer


def test_no_transfer_begins_while_another_client_talks_to_the_pe() -> None:
    flight = Flight()
    flight.fly(longest_ns=4_900 * MS)
    flight.manager.hear(Frame(REQUEST, bytes(8)))
    flight.fly(longest_ns=1_900 * MS)
    assert flight.messages == 0
    flight.judge()


def test_the_transfer_of_another_client_is_not_aborted() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > 20)
    before = len(flight.manager.frames)
    flight.manager.hear(Frame(REQUEST, bytes(8)))
    flight.manager.pass_time(1_900 * MS)
    assert not [one for one in flight.manager.frames[before:] if one.can_id == REQUEST]


PLACE = f"module:{MODULE}@{PE}"


def latched(flight: Flight) -> dict[str, str]:
    return {one["element"]: one["code"] for one in flight.manager.core.status()["latched"]}


@pytest.mark.parametrize("order", [FailElement(PLACE), RetireElement(f"pe:{PE}")])
@pytest.mark.parametrize("first", [True, False])
def test_arriving_code_ends_no_order(order: FailElement | RetireElement, *, first: bool) -> None:
    flight = Flight(lack=not first)
    flight.manager.answer()
    deploy(flight.manager)
    say(flight.manager, order)
    if first:
        flight.manager.report(PE, LACK)
    assert latched(flight) == {PLACE: "OPERATOR"}
    assert flight.fly(flight.has_come)
    flight.fly(longest_ns=2_000 * MS)
    assert latched(flight) == {PLACE: "OPERATOR"}
    assert flight.manager.core.status()["code"] == {}
    assert len(flight.manager.of(events.CodeBrought)) == 1
    say(flight.manager, RestoreElement(f"module:{MODULE}@{PE}" if isinstance(order, FailElement) else f"pe:{PE}"))
    assert latched(flight) == {}


def test_an_order_that_ends_before_the_code_comes_leaves_the_lack() -> None:
    flight = Flight()
    flight.manager.answer()
    deploy(flight.manager)
    say(flight.manager, RetireElement(f"pe:{PE}"))
    say(flight.manager, RestoreElement(f"pe:{PE}"))
    assert latched(flight) == {PLACE: "MODULE_MISSING"}
    assert flight.fly(flight.has_come)
    assert latched(flight) == {}


@pytest.mark.parametrize("codes", [("MODULE_EXCEPTION", "MODULE_MISSING"), ("MODULE_MISSING", "MODULE_EXCEPTION")])
def test_arriving_code_ends_no_other_fault(codes: tuple[str, str]) -> None:
    flight = Flight(lack=False)
    for code in codes:
        flight.manager.report(PE, replace(LACK, code=FaultCode[code]))
    assert flight.fly(flight.has_come)
    assert latched(flight) == {PLACE: "MODULE_EXCEPTION"}
    say(flight.manager, ClearElement(PLACE))
    assert latched(flight) == {}


def test_a_write_that_is_not_needed_any_more_is_aborted_by_the_name_of_its_object() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > 20)
    flight.manager.die(PE)
    flight.manager.pass_time(500 * MS)
    (aborted,) = [one for one in flight.manager.frames if one.can_id == REQUEST and one.data[0] == ABORT]
    assert aborted.data == abort_message(PROGRAM_TRANSFER, 1, Abort.DEVICE_STATE)


@pytest.mark.parametrize(
    ("code", "why"), [(Abort.DEVICE_STATE, "it does not take it now"), (Abort.VALUE, "it refuses it")]
)
def test_a_part_that_the_pe_does_not_take_is_told_in_words_of_no_table(code: Abort, why: str) -> None:
    flight = Flight(lambda _: [(0, abort_message(PROGRAM_TRANSFER, 1, code))], 19)  # the answer to the first part
    assert flight.fly(lambda: bool(flight.manager.of(events.CodeNotTaken)))
    assert flight.manager.last(events.CodeNotTaken).why.startswith(why)
