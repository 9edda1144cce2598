"""A PE with a key: which commands it accepts, how it begins a new session, and that it refuses everything else."""

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.canopen_master import Master, refusal
from agent.one_pe import (
    BEAT_NS,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    MANAGER,
    MS,
    NEIGHBOUR,
    NODE,
    TABLE,
    Message,
    OnePe,
    sent,
    slice_messages,
)
from heronry_agent.core.authority import OutputAuthorization, Secret
from heronry_agent.core.vocabulary import Action
from heronry_wire.authentication import PAGE_1_BEAT, Key, Session
from heronry_wire.command_tags import Refusal
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    Command,
    management_id,
    state_id,
)
from heronry_wire.management import Alive, Control, Lease, Operation, Step
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Send
from heronry_wire.sdo import Abort
from heronry_wire.state_frames import PeState, StatePage0, StatePage1, StatePage2, StatePage3, decode_state, split_state
from lab.peers import PlayedManager

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
        self.manager = PlayedManager(MANAGER, self.term, KEY)

    def tell(self, *messages: Message, manager: PlayedManager | None = None) -> list[Action]:
        """Send commands, each with its TAG."""
        return self.pe.hear(*(manager or self.manager).frames(*messages))

    def nonce(self) -> int:
        """The nonce that the PE sends when it hears a manager that has not welcomed it."""
        self.pe.pass_time(2 * BEAT_NS)
        (page,) = said(self.tell(LEASE), StatePage2)
        assert isinstance(page, StatePage2)
        return page.nonce

    def welcome(self, nonce: int, manager: PlayedManager | None = None) -> list[Action]:
        """Answer a nonce."""
        return self.pe.hear(*(manager or self.manager).welcome(NODE, nonce))

    @property
    def refused(self) -> dict[Refusal, int]:
        """Number of refused commands, by reason."""
        assert self.pe.core.authenticity is not None
        return dict(self.pe.core.authenticity.refused)


@pytest.fixture
def keyed() -> Keyed:
    """Return a PE that has been welcomed."""
    one = Keyed()
    one.welcome(one.nonce())
    one.tell(LEASE, NAMES_IT)
    return one


def test_an_unanswered_question_is_repeated_once_a_period_and_another_start_asks_another() -> None:
    one = Keyed()
    first = one.nonce()
    assert not said(one.tell(LEASE, LEASE), StatePage2)
    assert one.nonce() == first
    one.pe.pass_time(5 * BEAT_NS)
    assert one.nonce() != first
    assert Keyed(salt=b"other").nonce() != first


@given(st.lists(st.tuples(st.integers(200, 219), st.binary(max_size=8)), max_size=30))
def test_whatever_comes_under_the_identifiers_of_managers_nothing_raises_and_nothing_is_accepted(
    said_so: list[tuple[int, bytes]],
) -> None:
    one = Keyed()
    one.welcome(one.nonce())
    for identifier, data in said_so:
        one.pe.hear(Frame(identifier, data))
        one.pe.pass_time(MS)
    assert (one.pe.core.followed_manager.term, one.pe.core.followed_manager.manager) == (
        1,
        MANAGER,
    )  # that sent WELCOME
    assert not one.pe.core.followed_manager.hears_lease(one.pe.now_ns)
    assert one.pe.core.active_configuration.state is PeState.UNCONFIGURED


# Terms and managers


# States


def test_page_1_is_tagged_with_what_it_has_staged(keyed: Keyed) -> None:
    session = Session(MANAGER, 1, 1)
    shown = [f.data for f in sent(keyed.tell(*slice_messages(FLYING, 7, 1007)), state_id(NODE)) if f.data[0] >> 6 == 1]
    said, tag = split_state(shown[-1])
    assert said == shown[-1][:3] + shown[-1][6:]
    assert tag == KEY.state_tag(NODE, session, PAGE_1_BEAT, said, 1007)
    untagged = [f.data for f in sent(Keyed().pe.pass_time(BEAT_NS), state_id(NODE)) if f.data[0] >> 6 == 1]
    assert [split_state(data)[1] for data in untagged] == [0]


# Denial


def test_frames_that_prove_nothing_make_a_pe_in_a_session_ask_for_none(keyed: Keyed) -> None:
    for manager, node in ((PlayedManager(127, 9, FOREIGN), 127), (PlayedManager(MANAGER, 9, FOREIGN), MANAGER)):
        for _ in range(6):
            keyed.tell(LEASE, NAMES_IT)
            forged = keyed.tell(Lease(9, 3, Step.GO_ALL, 7), manager=manager)
            forged += keyed.pe.hear(*manager.welcome(NODE, 7), Frame(management_id(node, Command.TAG), bytes(8)))
            assert not said(forged + keyed.pe.pass_time(BEAT_NS), StatePage2)
    keyed.pe.pass_time(6 * BEAT_NS)  # its manager has fallen silent: it asks each sender
    assert said(keyed.tell(Lease(9, 3, Step.GO_ALL, 7), manager=PlayedManager(127, 9, FOREIGN)), StatePage2)


def test_a_manager_of_a_higher_term_is_asked_for_a_session_at_once(keyed: Keyed) -> None:
    for term, asks in ((1, False), (2, True)):
        other = PlayedManager(127, term, KEY)
        keyed.pe.pass_time(2 * BEAT_NS)
        keyed.tell(LEASE, NAMES_IT)
        assert bool(said(keyed.tell(Lease(term, 0, Step.PREPARED, 0), manager=other), StatePage2)) is asks
        assert not said(keyed.tell(Alive(term, 0, frozenset()), manager=other), StatePage2)


def test_a_session_lasts_through_another_welcome_of_its_term(keyed: Keyed) -> None:
    session = Session(MANAGER, 1, 1)
    keyed.pe.pass_time(6 * BEAT_NS)
    unknown = PlayedManager(127, 1, FOREIGN)
    (page,) = said(keyed.tell(LEASE, manager=unknown), StatePage2)
    assert isinstance(page, StatePage2)
    keyed.welcome(page.nonce)
    shown = [f.data for f in sent(keyed.tell(*slice_messages(FLYING, 7, 1007)), state_id(NODE)) if f.data[0] >> 6 == 1]
    covered, tag = split_state(shown[-1])
    assert tag == KEY.state_tag(NODE, session, PAGE_1_BEAT, covered, 1007)


def test_only_what_the_key_has_made_shows_that_a_pe_was_replaced(keyed: Keyed) -> None:
    authorization = keyed.pe.core.output_authorization
    for _ in range(7):
        keyed.tell(LEASE, NAMES_IT)
        keyed.pe.pass_time(BEAT_NS)
    for evidence, holds in (
        (keyed.manager.frames(Lease(1, 9, Step.PREPARED, 7)), False),
        (PlayedManager(127, 2, FOREIGN).frames(Lease(2, 9, Step.GO, 7)), False),
        (PlayedManager(127, 2, KEY).frames(Lease(2, 9, Step.PREPARED, 7)), False),
        (PlayedManager(127, 2, KEY).frames(Alive(2, 0, frozenset())), False),
        (PlayedManager(127, 2, KEY).frames(Lease(2, 9, Step.GO, 7)), True),
    ):
        keyed.pe.hear(*evidence)
        assert authorization.allows(keyed.pe.now_ns) is not holds


def test_a_neighbour_counts_with_a_key_only_after_a_silence() -> None:
    for has_key, holds in ((False, True), (True, False)):
        authorization = OutputAuthorization(5 * BEAT_NS, revoked=lambda: None, has_key=has_key)
        authorization.named(True, 0, has_activated=True)
        authorization.neighbour_runs(8, 7)
        assert authorization.allows(1) is not holds
    authorization.heard(6 * BEAT_NS)
    for beat in range(7, 14):
        authorization.heard(beat * BEAT_NS)
    assert authorization.allows(14 * BEAT_NS)  # nobody is heard that runs a newer epoch
    authorization.neighbour_runs(8, 7)
    assert not authorization.allows(14 * BEAT_NS)


# The lock


def test_a_pe_without_a_key_ignores_the_commands_for_keys() -> None:
    pe = OnePe()
    assert not pe.command(Control(1, NODE, Operation.UNLOCK, 9), Control(1, NODE, Operation.RENEW))[1:]


# Gateways


def test_a_gateway_hands_on_the_welcome_of_a_node_beyond_and_not_that_of_another() -> None:
    one = Keyed(GATEWAY_TABLE)
    assert not [action for action in one.welcome(one.nonce()) if isinstance(action, Send) and action.port == 1]
    for node, passes in ((FAR, 2), (NEIGHBOUR, 0)):
        control, tag = one.manager.welcome(node, 5)
        actions = one.pe.hear(control) + one.pe.hear(tag)
        assert sum(len(sent(actions, frame.can_id, 1)) for frame in (control, tag)) == passes
    one.pe.hear(one.manager.welcome(FAR, 6)[0])
    one.pe.pass_time(6 * BEAT_NS)
    one.pe.hear(one.manager.welcome(FAR, 7)[1])  # its nonce has expired
    assert one.refused == {Refusal.UNKNOWN: 1, Refusal.STRAY: 1}


def test_a_tag_without_a_byte_is_counted(keyed: Keyed) -> None:
    keyed.pe.hear(keyed.manager.welcome(FAR, 1)[0])
    keyed.pe.hear(Frame(management_id(MANAGER, Command.TAG), b""))
    assert keyed.refused[Refusal.MALFORMED] == 1


def test_a_pe_that_runs_takes_its_own_table_sealed_with_the_key_alone(keyed: Keyed) -> None:
    sdo, text = Master(keyed.pe).sdo, TABLE.to_json().encode()
    table, challenge = sdo["Table of this PE"], sdo["Challenge"].raw
    keyed.tell(Control(1, NODE, Operation.UNLOCK, 30))
    foreign = KEY.sealed(GATEWAY_TABLE.to_json().encode(), challenge)
    for written, code in ((text, Abort.VALUE), (foreign, Abort.DEVICE_STATE)):
        assert refusal(lambda written=written: setattr(table, "raw", written)) == code.value
    table.raw = KEY.sealed(text, challenge)
