"""A manager brings a waiting PE its table: both cores, and every message between them lost, doubled, late or damaged.

What must hold whatever happens: the PE has no table or exactly its own; in the end it has it; the other PEs
stay available.
"""

from collections.abc import Callable, Collection
from hashlib import sha256
from itertools import pairwise

import pytest

from heronry_agent.core.authority import Secret
from heronry_agent.core.vocabulary import Note
from heronry_agent.shell.table_waiting import WaitingCore
from heronry_dg.loader import loads
from heronry_manager import events
from heronry_manager.core.provisioning import table_bringing
from heronry_manager.core.tables import Compiler, PeTables
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.canopen_objects import CHALLENGE, TABLE_TRANSFER
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id
from heronry_wire.part_transfer import Part, Transfer
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.sdo import Abort, abort_message
from heronry_wire.state_frames import Reason
from lab.peers import PlayedObjects
from manager.messages_on_the_way import Change, Exchange, changes
from manager.one_manager import MS, SPEC_TEXT, OneManager, two_tails
from manager.test_table_pace import has_nothing, open_blocks
from thoroughness import IS_WHOLE

PE, NODE = "right", 94
SPEC = two_tails()
OWN = PeTable.from_json(PeTables(Compiler(SPEC), ()).text(PE))
LONGEST_NS = 12_000 * MS

CHANGES = changes(TABLE_TRANSFER, 1)


class Flight(Exchange):
    """Two PEs that are available, one that waits, and their manager.

    change: what becomes of message number `at` between manager and waiting PE; None: nothing.
    key: of both; then the PE draws another challenge at each start, and no other PE proves anything.
    """

    def __init__(self, change: Change | None = None, at: int = -1, *, key: Key | None = None) -> None:
        self.key, self.starts = key, 0
        manager = OneManager(key=key, brings_tables=True)
        manager.start(fly=False)
        manager.die(PE)
        manager.pass_time(1_200 * MS)
        super().__init__(manager, NODE, change, at)
        self.notes: list[str] = []
        self.restart_pe()

    def restart_pe(self) -> None:
        self.starts += 1
        secret = None if self.key is None else Secret(self.key, self.starts.to_bytes(8))
        self.pe = WaitingCore(NODE, 1_000_000, self.manager.now_ns, secret)

    def fly(self, until: Callable[[], bool], longest_ns: int = LONGEST_NS) -> bool:
        return super().fly(until, longest_ns)

    @property
    def identifiers(self) -> Collection[int]:
        return self.pe.identifiers

    def due_ns(self, end_ns: int) -> int:
        return min(self.pe.next_deadline_ns(), end_ns)

    def hear(self, frame: Frame) -> None:
        self._do(self.pe.step(self.manager.now_ns, Received(0, frame)))

    def tick(self) -> None:
        if self.pe.next_deadline_ns() <= self.manager.now_ns:
            self._do(self.pe.step(self.manager.now_ns, Tick()))
        assert self.pe.table in (None, OWN)

    def _do(self, actions: list[object]) -> None:
        self.notes += [action.text for action in actions if isinstance(action, Note)]
        for action in actions:
            if isinstance(action, Send):
                self.pass_on(action.frame)

    def has_table(self) -> bool:
        return self.pe.table is not None

    def change_manager(self) -> None:
        """Let another manager take over, of the same version and spec."""
        now_ns = self.manager.now_ns
        self.manager = OneManager(node=127, term=2, key=self.key, brings_tables=True)
        self.manager.start(fly=False)
        self.manager.die(PE)
        self.manager.pass_time(now_ns + 1_200 * MS - self.manager.now_ns)
        self.sent = len(self.manager.frames)
        self.on_the_way.clear()

    def received(self) -> int:
        """Return how many bytes of its table the PE has."""
        return self.pe.received.length

    def judge(self) -> None:
        """The PE gets its table, and no other PE is lost."""
        assert self.fly(self.has_table), self.notes
        assert self.pe.table == OWN
        assert {one.pe for one in self.manager.of(events.PeLost)} <= {PE}


def messages_of_a_transfer(key: Key | None = None) -> int:
    flight = Flight(key=key)
    flight.judge()
    assert flight.fly(lambda: bool(flight.manager.of(events.TableBrought)))
    return flight.messages


KEY = Key(b"k" * KEY_BYTES)
MESSAGES, KEYED_MESSAGES = messages_of_a_transfer(), messages_of_a_transfer(KEY)


def test_a_waiting_pe_is_brought_its_table_in_a_tenth_of_the_bus() -> None:
    flight = Flight()
    flight.judge()
    assert flight.fly(lambda: bool(flight.manager.of(events.TableBrought)))
    (told,) = flight.manager.of(events.TableBrought)
    assert told.pe == PE
    assert told.took_ns >= told.bytes // 7 * 10 * 135_000  # one frame of 135 bits in ten, at 1 Mbit/s
    assert flight.notes == ["PE right of two_tails"]
    assert not flight.manager.of(events.TableNotTaken)


@pytest.mark.parametrize("name", CHANGES)
def test_whatever_becomes_of_a_message_the_pe_gets_its_whole_table_or_none_yet(name: str) -> None:
    few = (0, 1, 2, MESSAGES // 2, *range(MESSAGES - 4, MESSAGES))
    for at in range(MESSAGES) if IS_WHOLE else few:
        Flight(CHANGES[name], at).judge()


@pytest.mark.parametrize("name", CHANGES)
def test_with_a_key_it_is_the_same_and_the_challenge_goes_first(name: str) -> None:
    few = (0, 1, 2, 3, KEYED_MESSAGES // 2, *range(KEYED_MESSAGES - 4, KEYED_MESSAGES))
    for at in range(KEYED_MESSAGES) if IS_WHOLE else few:
        Flight(CHANGES[name], at, key=KEY).judge()


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("at", [0, 1, 2, MESSAGES // 2, MESSAGES - 2, MESSAGES - 1])
def test_a_pe_that_restarts_during_the_transfer_is_brought_the_table_anew(at: int, key: Key | None) -> None:
    flight = Flight(key=key)
    assert flight.fly(lambda: flight.messages > at)
    flight.restart_pe()
    flight.judge()


def cut_by_another_client(flight: Flight) -> None:
    flight.manager.hear(Frame(sdo_request_id(NODE), bytes(8)))


def cut_by_an_abort(flight: Flight) -> None:
    flight.manager.hear(Frame(sdo_response_id(NODE), abort_message(TABLE_TRANSFER, 1, Abort.TIME_OUT)))


def cut_by_a_takeover(flight: Flight) -> None:
    flight.change_manager()


def cut_by_silence(flight: Flight) -> None:
    """Neither hears the other one for three seconds."""
    flight.on_the_way.clear()
    flight.manager.pass_time(3_000 * MS)
    flight.sent = len(flight.manager.frames)


CUTS = [cut_by_another_client, cut_by_an_abort, cut_by_silence]


@pytest.mark.parametrize(
    ("cut", "key"), [*((cut, key) for cut in CUTS for key in (None, KEY)), (cut_by_a_takeover, None)]
)
def test_a_transfer_that_was_cut_off_goes_on_where_it_was(
    cut: Callable[[Flight], None], key: Key | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_bringing, "PART_BYTES", 140)
    flight = Flight(key=key)
    assert flight.fly(lambda: flight.received() >= 560)
    cut(flight)
    before = flight.messages
    flight.judge()
    of_what_is_left = (len(PeTables(Compiler(SPEC), ()).contents()[PE]) + 32 - 560) // 7
    assert flight.messages - before < of_what_is_left + 60  # the question, the part that was on its way, the answers


def test_a_table_whose_parts_are_of_two_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_bringing, "PART_BYTES", 140)
    flight = Flight()
    assert flight.fly(lambda: flight.received() >= 280)
    objects = flight.pe._canopen._sdo._objects
    content = PeTables(Compiler(SPEC), ()).contents()[PE]
    own = Transfer(sha256(content).digest(), len(content))
    assert objects.write(TABLE_TRANSFER, 1, Part(own, flight.received(), bytes(140)).encode()) is None  # forged
    flight.judge()
    assert [one.why for one in flight.manager.of(events.TableNotTaken)]


def test_another_client_goes_first_and_nothing_is_told_of_it() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > MESSAGES // 2)
    flight.manager.hear(Frame(sdo_request_id(NODE), bytes(8)))
    before = flight.sent
    assert not flight.fly(lambda: False, 1_900 * MS)
    assert not [one for one in flight.manager.frames[before:] if one.can_id == sdo_request_id(NODE)]
    flight.judge()
    assert not flight.manager.of(events.TableNotTaken)


def waits(manager: OneManager, state: bytes = b"\x7f") -> list[Frame]:
    """Let a PE send a heartbeat; gives what the manager asks of it in the next seconds."""
    before = len(manager.frames)
    manager.hear(Frame(heartbeat_id(NODE), state))
    manager.pass_time(100 * MS)
    return [one for one in manager.frames[before:] if one.can_id == sdo_request_id(NODE)]


def test_only_a_pe_that_waits_is_brought_a_table() -> None:
    manager = OneManager(brings_tables=True)
    manager.start()
    assert not waits(manager)  # it flies
    manager.die(PE)
    manager.pass_time(500 * MS)
    assert not waits(manager)  # its modules may not be free yet
    manager.pass_time(1_000 * MS)
    assert not waits(manager, b"\x05")
    assert not waits(manager, b"")
    assert len(waits(manager)) == 1
    other = OneManager()
    other.start(fly=False)
    other.die(PE)
    other.pass_time(1_500 * MS)
    assert not other.core.hears(heartbeat_id(NODE))
    assert not waits(other)


def test_a_pe_that_does_not_answer_is_asked_less_and_less_and_told_once() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    asked = 0
    for _ in range(60):
        asked += len(waits(manager))
        manager.pass_time(900 * MS)
    assert 4 <= asked <= 7
    (told,) = manager.of(events.TableNotTaken)
    assert (told.pe, told.why) == (PE, "it did not answer")


def test_a_pe_that_is_not_heard_any_more_is_forgotten() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    for pause_ms in (1_000, 2_000, 4_000):
        assert waits(manager)
        manager.pass_time((1_000 + pause_ms) * MS)
    assert waits(manager)
    manager.pass_time(1_000 * MS)  # without an answer: a pause of 8 s begins
    assert not waits(manager)
    before = len(manager.frames)
    manager.pass_time(10_000 * MS)
    assert not [one for one in manager.frames[before:] if one.can_id == sdo_request_id(NODE)]


def test_a_manager_that_falls_silent_forgets_the_transfer() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > MESSAGES // 2)
    for pe in list(flight.manager.running):
        flight.manager.die(pe)
    flight.manager.pass_time(3_000 * MS)
    assert not flight.manager.core.is_active
    assert not waits(flight.manager)


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\xff" * 8,
        b"\xa4\x26\x20\x01\x00\x00\x00\x00",  # blocks of no segment
        b"\xa2\x05\x20\x00\x00\x00\x00\x00",  # an acknowledgement before the transfer is open
        abort_message(TABLE_TRANSFER, 1, Abort.VALUE),
        abort_message(TABLE_TRANSFER, 1, Abort.DEVICE_STATE),
    ],
)
def test_an_answer_that_does_not_fit_ends_the_transfer_and_is_told(answer: bytes) -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    assert waits(manager)
    manager.hear(Frame(sdo_response_id(NODE), answer))
    assert len(manager.of(events.TableNotTaken)) == 1


def test_a_pe_that_receives_nothing_is_given_up() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    assert waits(manager)
    open_blocks(manager, 4)
    for _ in range(4):
        manager.pass_time(50 * MS)
        manager.hear(Frame(sdo_response_id(NODE), b"\xa2\x00\x04\x00\x00\x00\x00\x00"))
    (told,) = manager.of(events.TableNotTaken)
    assert told.why == "it received nothing"


def test_a_table_that_is_taken_and_does_not_fly_is_told_of_and_brought_less_and_less() -> None:
    flight = Flight()
    for _ in range(5):
        assert flight.fly(flight.has_table, 20_000 * MS)
        flight.restart_pe()
    (told,) = flight.manager.of(events.TableNotTaken)
    assert told.why == "it took its table, and waits for one again: its log says why"
    brought = [one.t_ns for one in flight.manager.of(events.TableBrought)]
    pauses = [after - before for before, after in pairwise(brought)]
    assert pauses == sorted(pauses)
    assert pauses[-1] > 2 * pauses[0]
    flight.manager.live(PE)
    flight.manager.pass_time(3_000 * MS)
    flight.manager.hear(Frame(heartbeat_id(NODE), b"\x05"))
    flight.manager.die(PE)
    flight.manager.pass_time(1_500 * MS)
    assert flight.fly(flight.has_table, 4_000 * MS)  # it has flown, so the next one comes soon
    assert len(flight.manager.of(events.TableNotTaken)) == 1


def test_a_pe_with_which_another_client_talks_is_left_to_it() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    manager.hear(Frame(sdo_request_id(NODE), bytes(8)))
    assert not waits(manager)
    manager.pass_time(1_800 * MS)
    before = len(manager.frames)
    manager.pass_time(300 * MS)
    assert [one for one in manager.frames[before:] if one.can_id == sdo_request_id(NODE)]


def test_a_pe_with_a_long_heartbeat_period_is_quiet_only_after_two_of_them() -> None:
    text = SPEC_TEXT.replace("bitrate: 1000000", "bitrate: 1000000, heartbeat_ms: 2000")
    assert text != SPEC_TEXT
    manager = OneManager(loads(text, "slow.dg.yaml"), brings_tables=True)
    manager.live(PE)
    manager.pass_time(30_000 * MS)
    manager.live("left")
    manager.live("middle")
    manager.die(PE)
    manager.pass_time(12_000 * MS)
    assert not manager.core._known.health.is_available(PE)
    manager.hear(Frame(manager.state_id(PE), manager.running["left"].encode()))
    manager.pass_time(3_500 * MS)
    assert not waits(manager)
    manager.pass_time(1_000 * MS)
    assert waits(manager)


def test_a_transfer_ends_when_its_pe_flies() -> None:
    flight = Flight()
    assert flight.fly(lambda: flight.messages > MESSAGES // 2)
    flight.manager.live(PE)
    before = len(flight.manager.frames)
    flight.manager.pass_time(4_000 * MS)
    sent = [one.data for one in flight.manager.frames[before:] if one.can_id == sdo_request_id(NODE)]
    assert len(sent) <= 2
    assert sent[-1] == abort_message(TABLE_TRANSFER, 1, Abort.DEVICE_STATE)
    assert not flight.manager.of(events.TableBrought)


def test_with_a_key_a_pe_that_flies_before_its_table_is_sealed_is_left_alone() -> None:
    flight = Flight(key=KEY)
    assert flight.fly(lambda: flight.messages == 1)  # the challenge was requested
    flight.manager.live(PE)
    flight.manager.pass_time(3_000 * MS)
    flight.manager.hear(Frame(sdo_response_id(NODE), b"\x43\x24\x20\x00\x01\x02\x03\x04"))
    assert flight.messages == 1
    assert not flight.manager.of(events.TableNotTaken)


@pytest.mark.parametrize("length", [0, 5, 8, 40, 4096])
def test_a_challenge_that_is_no_number_is_none(length: int) -> None:
    flight, played = Flight(key=KEY), PlayedObjects()
    assert flight.fly(lambda: flight.messages == 1)
    played.values[NODE, CHALLENGE, 0] = b"\xff" * length
    while not flight.manager.of(events.TableNotTaken):
        asked = next(one for one in reversed(flight.manager.frames) if one.can_id == sdo_request_id(NODE))
        flight.manager.hear(Frame(sdo_response_id(NODE), played.answer(NODE, asked.data)))
    assert flight.manager.last(events.TableNotTaken).why == "it did not answer"


def test_an_acknowledgement_of_more_segments_than_were_sent_ends_the_transfer() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    assert waits(manager)
    open_blocks(manager, 127)
    manager.hear(Frame(sdo_response_id(NODE), b"\xa2\x7e\x7f\x00\x00\x00\x00\x00"))
    (told,) = manager.of(events.TableNotTaken)
    assert told.why == "an answer did not fit"


def test_a_pe_with_another_table_that_runs_nothing_is_brought_its_own_and_one_that_flies_is_not() -> None:
    manager = OneManager(brings_tables=True)
    manager.start(fly=False)
    manager.answer()
    manager.stage(PE, Reason.DIGEST)
    assert not manager.core._known.health.is_available(PE)
    assert not waits(manager, b"\x7f")  # the manager reads first which table it is
    before = len(manager.frames)
    manager.pass_time(2_000 * MS)
    (asked,) = [one for one in manager.frames[before:] if one.can_id == sdo_request_id(NODE)]
    assert asked.data[1:3] == TABLE_TRANSFER.to_bytes(2, "little")
    has_nothing(manager)
    manager.hear(Frame(sdo_response_id(NODE), abort_message(TABLE_TRANSFER, 1, Abort.DEVICE_STATE)))
    (told,) = manager.of(events.TableNotTaken)
    assert told.why.startswith("it keeps another table: start its agent with --node")
    manager.reboot(PE)
    manager.pass_time(2_000 * MS)
    assert manager.core._known.health.is_available(PE)
    assert not waits(manager, b"\x7f")
