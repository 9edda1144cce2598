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
from heronry_agent.core.authenticity import Secret
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
    """Give a PE that has been welcomed."""
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
    assert (one.pe.core.mastership.term, one.pe.core.mastership.manager) == (1, MANAGER)  # that sent WELCOME
    assert not one.pe.core.mastership.hears_lease(one.pe.now_ns)
    assert one.pe.core.reconfiguration.state is PeState.UNCONFIGURED


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
    table, text = Master(keyed.pe).sdo["Table of this PE"], TABLE.to_json().encode()
    keyed.tell(Control(1, NODE, Operation.UNLOCK, 30))
    for written, code in ((text, Abort.VALUE), (KEY.sealed(GATEWAY_TABLE.to_json().encode()), Abort.DEVICE_STATE)):
        assert refusal(lambda written=written: setattr(table, "raw", written)) == code.value
    table.raw = KEY.sealed(text)
