"""A PE with a key: whom it believes, how it comes to, and what it makes of everything else."""

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.one_pe import (
    BEAT_NS,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    MANAGER,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_MONITOR,
    TABLE,
    Message,
    OnePe,
    command_frame,
    sent,
    slice_messages,
)
from heronry_agent.core.authenticity import LONGEST_UNLOCK_S, Secret
from heronry_agent.core.vocabulary import Action, Note
from heronry_wire.authentication import BEAT_SPAN, PAGE_1_BEAT, Key, Session
from heronry_wire.command_tags import CommandSigner, Refusal
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    NMT_ID,
    Command,
    emcy_id,
    heartbeat_id,
    management_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import (
    NUMBER_SPAN,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Ping,
    Step,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Send
from heronry_wire.sdo import Abort, abort_message
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
    decode_state,
    split_state,
)

KEY, FOREIGN = Key(b"k" * 32), Key(b"f" * 32)
LEASE = Lease(1, 0, Step.PREPARED, 0)
NAMES_IT = Alive(1, 0, frozenset({NEIGHBOUR, NODE}))
Page = StatePage0 | StatePage1 | StatePage2 | StatePage3


def said(actions: list[Action], kind: type[Page]) -> list[Page]:
    """Pages of one kind that went out on the uplink."""
    pages = [decode_state(frame.data) for frame in sent(actions, state_id(NODE), 0)]
    return [page for page in pages if isinstance(page, kind)]


@dataclass
class Keyed:
    """A PE with a key, and a manager that has it too."""

    table: PeTable = field(default_factory=lambda: TABLE)
    salt: bytes = b"salt"
    term: int = 1

    def __post_init__(self) -> None:
        self.pe = OnePe(self.table, secret=Secret(KEY, self.salt))
        self.signer = CommandSigner(KEY, MANAGER, self.term)

    def tell(self, *messages: Message, signer: CommandSigner | None = None, manager: int = MANAGER) -> list[Action]:
        """Say commands, each with its TAG."""
        signer = signer or self.signer
        actions = []
        for message in messages:
            frame = command_frame(message, manager)
            actions += [*self.pe.hear(frame), *self.pe.hear(signer.tag(frame) or frame)]
        return actions

    def nonce(self) -> int:
        """What it asks when a manager speaks that it does not know."""
        self.pe.pass_time(2 * BEAT_NS)
        (page,) = said(self.tell(LEASE), StatePage2)
        assert isinstance(page, StatePage2)
        return page.nonce

    def welcome(self, nonce: int, signer: CommandSigner | None = None) -> list[Action]:
        """Answer a nonce."""
        return [one for frame in (signer or self.signer).welcome(NODE, nonce) for one in self.pe.hear(frame)]

    @property
    def refused(self) -> dict[Refusal, int]:
        """What it has refused."""
        assert self.pe.core.authenticity is not None
        return dict(self.pe.core.authenticity.refused)


@pytest.fixture
def keyed() -> Keyed:
    """Give a PE that has been welcomed."""
    one = Keyed()
    one.welcome(one.nonce())
    one.tell(LEASE, NAMES_IT)
    return one


def test_it_asks_at_its_start_and_believes_nobody_before_it_is_answered() -> None:
    one = Keyed()
    assert len(said(one.pe.pass_time(5 * BEAT_NS), StatePage2)) == 1
    assert not one.tell(Ping(1, NODE, 1))[:-1]
    assert one.refused == {Refusal.UNKNOWN: 1}
    assert one.pe.core.reign.term == 0


def test_an_unanswered_question_is_repeated_once_a_period_and_another_start_asks_another() -> None:
    one = Keyed()
    first = one.nonce()
    assert not said(one.tell(LEASE, LEASE), StatePage2)
    assert one.nonce() == first
    one.pe.pass_time(5 * BEAT_NS)
    assert one.nonce() != first
    assert Keyed(salt=b"other").nonce() != first


def test_once_welcomed_it_obeys_and_flies(keyed: Keyed) -> None:
    keyed.tell(*slice_messages(FLYING, 7, 1007), Activate(1, 7, Step.GO_ALL, 1007))
    assert keyed.pe.core.reconfiguration.state is PeState.ACTIVE


def test_the_same_commands_without_their_tags_do_nothing(keyed: Keyed) -> None:
    keyed.pe.command(*slice_messages(FLYING, 7, 1007), Activate(1, 7, Step.GO_ALL, 1007))
    keyed.tell(*slice_messages(FLYING, 7, 1007), signer=CommandSigner(FOREIGN, MANAGER, 1))
    assert keyed.pe.core.reconfiguration.state is PeState.UNCONFIGURED
    assert not keyed.pe.core.staging.collecting()
    assert keyed.refused[Refusal.UNPROVEN] == len(slice_messages(FLYING, 7, 1007))


def test_a_replay_and_an_old_welcome_do_nothing() -> None:
    one = Keyed()
    nonce = one.nonce()
    recorded = one.signer.welcome(NODE, nonce)
    one.welcome(nonce)
    ping = command_frame(Ping(1, NODE, 1))
    tag = one.signer.tag(ping)
    assert tag is not None
    assert len(said(one.pe.hear(ping) + one.pe.hear(tag), StatePage0)) == 1
    assert not said(one.pe.hear(ping) + one.pe.hear(tag), StatePage0)
    for frame in recorded:
        one.pe.hear(frame)
    assert one.refused == {Refusal.UNKNOWN: 1, Refusal.UNPROVEN: 1, Refusal.STALE: 1}


def test_a_welcome_that_comes_too_late_answers_nobody() -> None:
    one = Keyed()
    nonce = one.nonce()
    one.pe.pass_time(6 * BEAT_NS)
    one.welcome(nonce)
    assert one.refused[Refusal.UNKNOWN] == 2
    assert one.pe.core.reign.term == 0


def test_what_it_runs_and_what_it_refused_is_told_in_page_3_every_tenth_time(keyed: Keyed) -> None:
    for _ in range(3):
        keyed.tell(LEASE, signer=CommandSigner(FOREIGN, MANAGER, 1))
    pages = said(keyed.pe.pass_time(20 * BEAT_NS), StatePage3)
    told = [(page.digest, page.unproven, page.other) for page in pages if isinstance(page, StatePage3)]
    assert told == 2 * [(0, 3, 0)]


@given(st.lists(st.tuples(st.integers(200, 219), st.binary(max_size=8)), max_size=30))
def test_whatever_comes_under_the_identifiers_of_managers_nothing_raises_and_nothing_is_obeyed(
    said_so: list[tuple[int, bytes]],
) -> None:
    one = Keyed()
    one.welcome(one.nonce())
    for identifier, data in said_so:
        one.pe.hear(Frame(identifier, data))
        one.pe.pass_time(MS)
    assert (one.pe.core.reign.term, one.pe.core.reign.manager) == (1, MANAGER)  # who has welcomed it
    assert not one.pe.core.reign.hears_lease(one.pe.now_ns)
    assert one.pe.core.reconfiguration.state is PeState.UNCONFIGURED


# Terms and managers


def test_a_manager_that_was_restarted_is_believed_at_once_and_gives_a_new_session(keyed: Keyed) -> None:
    keyed.pe.pass_time(BEAT_NS)
    restarted = CommandSigner(KEY, MANAGER, 2)
    (asked,) = said(keyed.tell(Lease(2, 0, Step.PREPARED, 0), signer=restarted), StatePage2)
    assert keyed.pe.core.reign.term == 2
    assert isinstance(asked, StatePage2)
    keyed.welcome(asked.nonce, restarted)
    keyed.pe.pass_time(BEAT_NS)
    assert not said(keyed.tell(Lease(2, 0, Step.PREPARED, 0), signer=restarted), StatePage2)


def test_who_has_given_an_answer_in_a_higher_term_reigns_and_who_did_before_is_not_obeyed_any_more(
    keyed: Keyed,
) -> None:
    other = CommandSigner(KEY, 127, 2)
    keyed.pe.pass_time(2 * BEAT_NS)
    (asked,) = said(keyed.tell(Lease(2, 0, Step.PREPARED, 0), signer=other, manager=127), StatePage2)
    assert isinstance(asked, StatePage2)
    assert keyed.pe.core.reign.term == 1
    for frame in other.welcome(NODE, asked.nonce):
        keyed.pe.hear(frame)
    keyed.tell(*slice_messages(FLYING, 7, 1007), Activate(1, 7, Step.GO_ALL, 1007))
    assert (keyed.pe.core.reign.term, keyed.pe.core.reign.manager) == (2, 127)
    assert keyed.pe.core.reconfiguration.state is PeState.UNCONFIGURED


def test_the_other_manager_is_asked_and_then_believed(keyed: Keyed) -> None:
    keyed.pe.pass_time(BEAT_NS)
    standby, lease = CommandSigner(KEY, 127, 2), Lease(2, 0, Step.PREPARED, 0)
    (asked,) = said(keyed.tell(lease, signer=standby, manager=127), StatePage2)
    assert isinstance(asked, StatePage2)
    keyed.welcome(asked.nonce, standby)
    keyed.tell(lease, signer=standby, manager=127)
    assert (keyed.pe.core.reign.manager, keyed.pe.core.reign.term) == (127, 2)


def test_who_was_cut_off_for_too_long_asks_anew(keyed: Keyed) -> None:
    keyed.signer.number += 3 * NUMBER_SPAN + 5
    assert not said(keyed.tell(LEASE), StatePage2)
    keyed.pe.pass_time(6 * BEAT_NS)
    (asked,) = said(keyed.tell(LEASE), StatePage2)
    assert isinstance(asked, StatePage2)
    keyed.welcome(asked.nonce)
    keyed.tell(LEASE)
    assert keyed.pe.core.reign.hears_lease(keyed.pe.now_ns)


# States


def page_0(keyed: Keyed, beats: int) -> list[bytes]:
    """Payloads of the next pages 0."""
    frames = sent(keyed.pe.pass_time(beats * BEAT_NS), state_id(NODE))
    return [frame.data for frame in frames if frame.data[0] >> 6 == 0]


def test_its_states_are_tagged_for_its_session_and_never_twice_alike(keyed: Keyed) -> None:
    session, shown = Session(MANAGER, 1, 1), page_0(keyed, 300)
    for beat, data in enumerate(shown, start=shown[0][4]):
        assert data[4] == beat % BEAT_SPAN
        assert int.from_bytes(data[5:]) == KEY.state_tag(NODE, session, beat, data[:5], 0)
    assert len({data[5:] for data in shown}) > 290


def test_without_a_session_it_says_0_and_a_renewal_ends_one(keyed: Keyed) -> None:
    assert page_0(Keyed(), 1)[0][5:] == bytes(3)
    assert page_0(keyed, 1)[0][5:] != bytes(3)
    asked = said(keyed.tell(Control(1, NODE, Operation.RENEW)), StatePage2)
    assert len(asked) == 1
    assert page_0(keyed, 1)[0][5:] == bytes(3)


def test_page_1_is_tagged_with_what_it_has_staged(keyed: Keyed) -> None:
    session = Session(MANAGER, 1, 1)
    shown = [f.data for f in sent(keyed.tell(*slice_messages(FLYING, 7, 1007)), state_id(NODE)) if f.data[0] >> 6 == 1]
    said, tag = split_state(shown[-1])
    assert said == shown[-1][:3] + shown[-1][6:]
    assert tag == KEY.state_tag(NODE, session, PAGE_1_BEAT, said, 1007)
    untagged = [f.data for f in sent(Keyed().pe.pass_time(BEAT_NS), state_id(NODE)) if f.data[0] >> 6 == 1]
    assert [split_state(data)[1] for data in untagged] == [0]


LEFT, RIGHT = ((ElementKind.DEVICE, number) for number in (1, 2))


def proofs(actions: list[Action]) -> list[tuple[bool, bytes]]:
    """Of each page 0: whether it says that something is pending, and the EMCY that its tag covers."""
    emergencies = {frame.data for frame in sent(actions, emcy_id(NODE))}
    found = []
    for data in (f.data for f in sent(actions, state_id(NODE)) if f.data[0] >> 6 == 0):
        said, tag = split_state(data)
        pending = bool(data[0] & PeFlags.FAULT_PENDING)
        fits = [
            one
            for one in (b"", *emergencies)
            if tag == KEY.state_tag(NODE, Session(MANAGER, 1, 1), data[4], said, 1007, emergency=one)
        ]
        found.append((pending, *fits))
    return found


def test_each_emcy_is_proven_by_a_state_in_turn_and_the_first_at_once(keyed: Keyed) -> None:
    watching = Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR})
    keyed.tell(*slice_messages(watching, 7, 1007), Activate(1, 7, Step.GO_ALL, 1007))
    assert proofs(keyed.pe.pass_time(BEAT_NS)) == [(False, b"")]
    keyed.pe.reports[MONITOR] = (("device:left", 57), ("device:right", 58))
    actions = keyed.pe.pass_time(60 * MS)
    left, right = (Emergency(FaultCode.REPORTED, 0x81, *e, d).encode() for e, d in ((LEFT, 57), (RIGHT, 58)))
    shown = proofs(actions)
    assert {emergency for _, emergency in shown if emergency} == {left, right}
    assert all(pending is bool(emergency) for pending, emergency in shown)
    first = next(at for at, one in enumerate(actions) if isinstance(one, Send) and one.frame.can_id == emcy_id(NODE))
    at_once = [one.frame.can_id for one in actions[first:] if isinstance(one, Send)][:4]
    assert at_once == [emcy_id(NODE), emcy_id(NODE), state_id(NODE), emcy_id(NODE)] or state_id(NODE) in at_once
    keyed.pe.reports.clear()
    one_left = proofs(keyed.tell(Control(1, NODE, Operation.ACKNOWLEDGE, *LEFT)) + keyed.pe.pass_time(2 * BEAT_NS))
    assert {emergency for _, emergency in one_left} == {right}
    assert proofs(keyed.tell(Control(1, NODE, Operation.ACKNOWLEDGE, *RIGHT))) == [(False, b"")]


# The lock


def test_nmt_and_sdo_do_nothing_before_an_unlock_that_names_the_pe_and_nothing_after(keyed: Keyed) -> None:
    stop, write = Frame(NMT_ID, bytes((2, NODE))), Frame(sdo_request_id(NODE), bytes.fromhex("2B 17 10 00 F4 01 00 00"))
    refused = abort_message(0x1017, 0, Abort.DEVICE_STATE)
    keyed.pe.pass_time(BEAT_NS)
    keyed.pe.hear(stop)
    assert keyed.pe.core.counts["NMT command without an UNLOCK", NMT_ID] == 1
    assert [f.data for f in sent(keyed.pe.hear(write), sdo_response_id(NODE))] == [refused]
    keyed.tell(Control(1, NEIGHBOUR, Operation.UNLOCK, 10))
    assert [f.data for f in sent(keyed.pe.hear(write), sdo_response_id(NODE))] == [refused]
    keyed.tell(Control(1, NODE, Operation.UNLOCK, 1))
    assert [f.data[0] for f in sent(keyed.pe.hear(write), sdo_response_id(NODE))] == [0x60]
    keyed.pe.hear(stop)
    assert [f.data for f in sent(keyed.pe.pass_time(600 * MS), heartbeat_id(NODE))] == [b"\x04"]
    keyed.pe.pass_time(500 * MS)
    keyed.pe.hear(stop)
    assert keyed.pe.core.counts["NMT command without an UNLOCK", NMT_ID] == 2


def test_an_unlock_ends_whatever_it_says(keyed: Keyed) -> None:
    assert Note("unlock", "NMT and SDO may write for 60 s") in keyed.tell(Control(1, NODE, Operation.UNLOCK, 65535))
    keyed.pe.pass_time(LONGEST_UNLOCK_S * 1_000 * MS + BEAT_NS)
    assert keyed.pe.core.authenticity is not None
    assert not keyed.pe.core.authenticity.is_open


def test_without_a_key_these_orders_are_for_nobody() -> None:
    pe = OnePe()
    assert not pe.command(Control(1, NODE, Operation.UNLOCK, 9), Control(1, NODE, Operation.RENEW))[1:]


# Gateways


def test_a_gateway_hands_on_what_it_obeyed_with_its_tag_and_nothing_else() -> None:
    one = Keyed(GATEWAY_TABLE)
    one.welcome(one.nonce())
    ping = command_frame(Ping(1, FAR, 1))
    assert [frame.can_id for frame in sent(one.tell(Ping(1, FAR, 1)), ping.can_id, 1)] == [ping.can_id]
    assert len(sent(one.tell(Ping(1, FAR, 2)), management_id(MANAGER, Command.TAG), 1)) == 1
    forged = one.tell(Ping(1, FAR, 3), signer=CommandSigner(FOREIGN, MANAGER, 1))
    assert not sent(forged, ping.can_id, 1)


def test_a_gateway_hands_on_the_welcome_of_a_node_beyond_and_not_that_of_another() -> None:
    one = Keyed(GATEWAY_TABLE)
    assert not [action for action in one.welcome(one.nonce()) if isinstance(action, Send) and action.port == 1]
    for node, passes in ((FAR, 2), (NEIGHBOUR, 0)):
        control, tag = one.signer.welcome(node, 5)
        actions = one.pe.hear(control) + one.pe.hear(tag)
        assert sum(len(sent(actions, frame.can_id, 1)) for frame in (control, tag)) == passes
    one.pe.hear(one.signer.welcome(FAR, 6)[0])
    one.pe.pass_time(6 * BEAT_NS)
    one.pe.hear(one.signer.welcome(FAR, 7)[1])  # of a question that is forgotten by now
    assert one.refused == {Refusal.UNKNOWN: 1, Refusal.STRAY: 1}


def test_nobody_commands_from_beyond() -> None:
    one = Keyed(GATEWAY_TABLE)
    one.welcome(one.nonce())
    ping = command_frame(Ping(1, NODE, 1))
    tag = one.signer.tag(ping)
    assert tag is not None
    assert not one.pe.hear(ping, port=1) + one.pe.hear(tag, port=1)
    assert one.pe.core.counts["command from beyond", ping.can_id] == 1
    assert one.pe.core.counts["command from beyond", tag.can_id] == 1


def test_a_tag_without_a_byte_is_counted(keyed: Keyed) -> None:
    keyed.pe.hear(keyed.signer.welcome(FAR, 1)[0])
    keyed.pe.hear(Frame(management_id(MANAGER, Command.TAG), b""))
    assert keyed.refused[Refusal.MALFORMED] == 1
