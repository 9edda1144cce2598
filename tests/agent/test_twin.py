"""What the commands of a manager prove of a node with this PE's node-ID."""

import pytest

from heronry_agent.core.authority import Twin, TwinProof
from heronry_wire.authentication import Key
from heronry_wire.command_tags import CommandSigner
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, Command, management_id, state_id
from heronry_wire.management import Alive, Lease, Step

KEY, OTHER_KEY = Key(bytes(range(32))), Key(bytes(range(1, 33)))
NODE, MS = 95, 1_000_000
LOST_AFTER_NS = 100 * MS


class Bus:
    """A manager's commands, handed to the proof each with its tag, one heartbeat period after the other."""

    def __init__(self, key: Key = KEY, term: int = 0x107) -> None:
        self.proof = TwinProof(NODE, KEY, lost_after_ns=LOST_AFTER_NS, now_ns=0)
        self.signer, self.term, self.now_ns = CommandSigner(key, FIRST_MANAGER, term), term, 0

    def alive(self, *nodes: int, tag: bool = True, in_between: Frame | None = None) -> Twin:
        self.now_ns += 20 * MS
        said = Alive(self.term, 3, frozenset(nodes)).encode()
        return self.say(Frame(management_id(FIRST_MANAGER, Command.ALIVE), said), tag=tag, in_between=in_between)

    def say(self, frame: Frame, *, tag: bool = True, in_between: Frame | None = None) -> Twin:
        signed = self.signer.tag(frame)
        assert signed is not None
        found = self.proof.take(frame, self.now_ns)
        assert found is Twin.UNKNOWN
        if in_between is not None:
            assert self.proof.take(in_between, self.now_ns) is Twin.UNKNOWN
        return self.proof.take(signed, self.now_ns) if tag else Twin.UNKNOWN


def test_a_manager_that_does_not_name_this_pe_knows_no_other_node() -> None:
    assert Bus().alive(92, 93) is Twin.NONE


def test_a_pe_that_died_is_named_for_a_while() -> None:
    bus = Bus()
    told = [bus.alive(92, NODE) for _ in range(6)]
    assert told == [Twin.UNKNOWN] * 4 + [Twin.PROVEN] * 2


def test_what_no_holder_of_the_key_has_sent_proves_nothing() -> None:
    bus = Bus(OTHER_KEY)
    assert [bus.alive(92, *named) for named in ((), (NODE,)) * 8] == [Twin.UNKNOWN] * 16
    bus = Bus()
    assert [bus.alive(92, tag=False) for _ in range(8)] == [Twin.UNKNOWN] * 8


@pytest.mark.parametrize("can_id", [state_id(NODE), management_id(FIRST_MANAGER + 1, Command.TAG)])
def test_other_frames_in_between_change_nothing(can_id: int) -> None:
    assert Bus().alive(92, in_between=Frame(can_id, bytes(8))) is Twin.NONE


def test_a_replay_that_names_this_pe_is_contradicted_by_the_next_true_command() -> None:
    old, bus = Bus(), Bus(term=0x207)
    frame = Frame(management_id(FIRST_MANAGER, Command.ALIVE), Alive(old.term, 1, frozenset({NODE})).encode())
    tag = old.signer.tag(frame)
    assert tag is not None
    for at_ns in (1 * MS, 150 * MS):
        found = [bus.proof.take(one, at_ns) for one in (frame, tag)]
    assert found[-1] is Twin.UNKNOWN  # doubled: it is no newer than the first
    assert bus.alive(92) is Twin.NONE


def test_a_lease_proves_nothing() -> None:
    bus = Bus()
    lease = Frame(management_id(FIRST_MANAGER, Command.LEASE), Lease(bus.term, 1, Step.GO_ALL, 2).encode())
    assert bus.say(lease) is Twin.UNKNOWN


def test_a_malformed_alive_proves_nothing() -> None:
    bus = Bus()
    assert (
        bus.say(Frame(management_id(FIRST_MANAGER, Command.ALIVE), bus.term.to_bytes(2, "big") + b"\1")) is Twin.UNKNOWN
    )
