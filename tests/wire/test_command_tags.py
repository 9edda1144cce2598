"""Commands and their tags between a manager and a receiver, with an attacker in between.

For all that the attacker does, each accepted command was sent by the manager, in its order: never twice, never late.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.authentication import KEY_BYTES, MAX_NUMBER, Key, Place
from heronry_wire.command_tags import CommandSigner, CommandVerifier, Held, Refusal
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, classify, management_id
from heronry_wire.management import NUMBER_SPAN, TAG, Alive, Lease, Ping, Prepare, SliceBody, SliceHead, Step
from heronry_wire.sansio import InvariantError, Received

KEY, FOREIGN = Key(b"k" * KEY_BYTES), Key(b"f" * KEY_BYTES)
MS = 1_000_000
NONCE = 0x1234_5678_9ABC


def commands(term: int = 3) -> list[Frame]:
    """One command of each shape, as manager 126 sends them."""
    said = [
        (Command.LEASE, Lease(term, 7, Step.GO, 0xABCDEF).encode()),
        (Command.ALIVE, Alive(term, 1, frozenset({92, 93})).encode()),
        (Command.PREPARE, Prepare(term, 8, 0xFEDCBA).encode()),
        (Command.SLICE, SliceHead(92, 8, 4, 0x123456).encode()),
        (Command.SLICE, SliceBody(92, 8, 1, b"slice").encode()),
        (Command.PING, Ping(term, 92, 1).encode()),
    ]
    return [Frame(management_id(126, command), data) for command, data in said]


@dataclass
class Listener:
    """The receiver in a PE: frames in, accepted commands out."""

    verifier: CommandVerifier = field(default_factory=lambda: CommandVerifier(KEY, 20 * MS))
    nonce: int = NONCE
    now_ns: int = 0
    believed: list[Frame] = field(default_factory=list)

    def hear(self, *frames: Frame | None) -> list[Frame]:
        """Take frames, a quarter of a millisecond after each other; gives the commands that are accepted now."""
        before = len(self.believed)
        for frame in frames:
            assert frame is not None
            self.now_ns += MS // 4
            meaning = classify(frame.can_id)
            assert meaning.node_id is not None
            assert meaning.command is not None
            if meaning.command is Command.TAG:
                found = self.verifier.tagged(meaning.node_id, frame.data, self.now_ns, self.nonce)
                if isinstance(found, Held):
                    self.believed.append(found.event.frame)
            else:
                self.verifier.hold(meaning.node_id, meaning.command, Received(0, frame), self.now_ns)
        return self.believed[before:]


def welcomed(signer: CommandSigner) -> Listener:
    """Return a listener that has been welcomed."""
    listener = Listener()
    listener.hear(*signer.welcome(92, NONCE))
    assert listener.verifier.places[126] == Place(3, signer.number)
    listener.believed.clear()
    return listener


def said_by(signer: CommandSigner, said: Sequence[Frame]) -> list[Frame | None]:
    """Return commands, each with its TAG behind it."""
    return [one for frame in said for one in (frame, signer.tag(frame))]


def test_what_the_manager_says_is_believed_in_its_order() -> None:
    signer = CommandSigner(KEY, 126, 3)
    listener = welcomed(signer)
    assert listener.hear(*said_by(signer, commands())) == commands()
    assert not listener.verifier.refused


def test_commands_may_overtake_the_tags_of_others() -> None:
    signer = CommandSigner(KEY, 126, 3)
    listener = welcomed(signer)
    tags = [signer.tag(frame) for frame in commands()]
    assert listener.hear(*sorted(commands()), *tags) == commands()


def test_before_a_fresh_start_nothing_is_believed_and_an_old_answer_is_none() -> None:
    signer = CommandSigner(KEY, 126, 3)
    recorded = signer.welcome(92, nonce=77)  # to the nonce of this PE before its restart
    listener = Listener()
    assert not listener.hear(*said_by(signer, commands()))
    assert listener.verifier.refused == {Refusal.UNKNOWN: len(commands())}
    assert not listener.hear(*recorded)
    assert listener.hear(*signer.welcome(92, NONCE))


def test_an_answer_serves_once() -> None:
    signer = CommandSigner(KEY, 126, 3)
    answer = signer.welcome(92, NONCE)
    listener = Listener()
    listener.hear(*answer)
    listener.hear(*said_by(signer, commands()))
    place = listener.verifier.places[126]
    assert not listener.hear(*answer)
    assert listener.verifier.places[126] == place
    assert listener.verifier.refused == {Refusal.STALE: 1}


def test_a_new_term_begins_anew_and_the_old_one_is_over() -> None:
    old, new = CommandSigner(KEY, 126, 3), CommandSigner(KEY, 126, 4)
    listener = welcomed(old)
    listener.hear(*said_by(old, commands()))
    assert listener.hear(*said_by(new, commands(4))) == commands(4)
    assert not listener.hear(*said_by(old, commands()[:3]))
    assert listener.verifier.refused[Refusal.STALE] == 3


def test_the_other_manager_has_a_place_of_its_own() -> None:
    listener = welcomed(CommandSigner(KEY, 126, 3))
    other = CommandSigner(KEY, 127, 9)
    lease = Frame(management_id(127, Command.LEASE), Lease(9, 7, Step.GO, 1).encode())
    assert not listener.hear(lease, other.tag(lease))
    assert listener.verifier.refused == {Refusal.UNKNOWN: 1}


def test_what_was_lost_takes_nothing_else_with_it() -> None:
    signer = CommandSigner(KEY, 126, 3)
    listener = welcomed(signer)
    first, second, third = (Frame(203, SliceBody(92, 8, index, b"12345").encode()) for index in (1, 2, 3))
    tags = [signer.tag(frame) for frame in (first, second, third)]
    assert listener.hear(first, tags[0], second, third, tags[2]) == [first, third]  # one TAG lost
    assert listener.verifier.refused == {Refusal.UNTAGGED: 1}
    fourth, fifth = signer.tag(first), signer.tag(second)
    assert listener.hear(fourth, second, fifth) == [second]  # one command lost
    assert listener.verifier.refused == {Refusal.UNTAGGED: 1, Refusal.STRAY: 1}


def test_one_that_comes_twice_makes_those_after_it_no_older() -> None:
    """A LEASE repeats the same bytes each period."""
    signer, verifier = CommandSigner(KEY, 126, 3), CommandVerifier(KEY, 100 * MS)
    answer, tag = signer.welcome(92, NONCE)
    verifier.hold(126, Command.CONTROL, Received(0, answer), 0)
    assert isinstance(verifier.tagged(126, tag.data, 0, NONCE), Held)
    lease = commands()[0]
    for beat, times in enumerate((1, 2, 3, 1, 1)):
        signed = signer.tag(lease)
        assert signed is not None
        for copy in range(times):
            verifier.hold(126, Command.LEASE, Received(0, lease), 20 * beat * MS + copy)
        found = verifier.tagged(126, signed.data, 20 * beat * MS + MS)
        assert isinstance(found, Held)
        assert found.arrived_ns == 20 * beat * MS + times - 1
    assert verifier.refused.total() == 0


def test_a_command_does_not_wait_for_ever() -> None:
    signer = CommandSigner(KEY, 126, 3)
    listener = welcomed(signer)
    lease, tag = said_by(signer, commands()[:1])
    listener.hear(lease)
    listener.now_ns += 20 * MS
    assert not listener.hear(tag)
    assert listener.verifier.refused == {Refusal.UNTAGGED: 1, Refusal.STRAY: 1}


def test_a_flood_of_commands_takes_no_more_room_than_there_is() -> None:
    signer = CommandSigner(KEY, 126, 3)
    listener = welcomed(signer)
    listener.verifier.hold(126, Command.LEASE, Received(0, Frame(200, b"flood")), 0)
    for _ in range(100):
        listener.verifier.hold(126, Command.LEASE, Received(0, Frame(200, b"flood")), MS)
    assert listener.verifier.refused == {Refusal.UNTAGGED: 61}
    assert listener.hear(*said_by(signer, commands()[:1])) == commands()[:1]


def test_a_receiver_that_has_missed_too_many_commands_needs_a_new_welcome() -> None:
    signer = CommandSigner(KEY, 126, 3)
    listener = welcomed(signer)
    signer.number += NUMBER_SPAN
    assert not listener.hear(*said_by(signer, commands()))
    assert listener.verifier.refused == {Refusal.UNPROVEN: len(commands())}
    listener.hear(*signer.welcome(92, NONCE))
    assert listener.hear(*said_by(signer, commands())) == commands()


def test_numbers_come_to_an_end_before_they_come_back() -> None:
    signer = CommandSigner(KEY, 126, 3)
    signer.number = MAX_NUMBER - 1
    listener = Listener()
    assert listener.hear(*signer.welcome(92, NONCE))
    with pytest.raises(InvariantError, match="start the manager anew"):
        signer.tag(commands()[0])
    tag = Frame(207, TAG.pack(Command.LEASE, 0, 0))
    assert not listener.hear(commands()[0], tag)
    assert listener.verifier.refused == {Refusal.STALE: 1}


def test_a_tag_cut_short_is_counted_and_what_is_no_command_has_none() -> None:
    listener = welcomed(CommandSigner(KEY, 126, 3))
    assert not listener.hear(Frame(207, b"short"))
    assert listener.verifier.refused == {Refusal.MALFORMED: 1}
    assert CommandSigner(KEY, 126, 3).tag(Frame(257, bytes(8))) is None


def test_another_manager_is_known_by_its_tags_alone() -> None:
    signer = CommandSigner(KEY, 126, 3)
    signer.number = 123 * NUMBER_SPAN
    seeker = Listener(CommandVerifier(KEY, 20 * MS, seek=True))
    foreign = CommandSigner(FOREIGN, 126, 3)
    assert not seeker.hear(*said_by(foreign, commands()[:1]))
    assert not seeker.hear(*said_by(signer, commands()[:1]))  # it has just tried the numbers, and pauses
    seeker.now_ns += 20 * MS
    assert seeker.hear(*said_by(signer, commands()[:1])) == commands()[:1]
    assert seeker.hear(*said_by(signer, commands())) == commands()


Meddling = tuple[str, int, int]
MEDDLINGS = st.tuples(
    st.sampled_from(("drop", "double", "swap", "flip", "cut", "replay", "foreign", "impostor", "answer")),
    st.integers(0, 40),
    st.integers(0, 255),
)


@given(st.lists(MEDDLINGS, max_size=12), st.lists(st.integers(0, 5), min_size=1, max_size=12))
def test_whatever_is_done_to_the_frames_what_is_believed_was_said_and_in_that_order(
    meddlings: list[Meddling], chosen: list[int]
) -> None:
    signer = CommandSigner(KEY, 126, 3)
    recorded = said_by(CommandSigner(KEY, 126, 2), commands(2))  # of the previous term
    listener = welcomed(signer)
    said = [
        frame._replace(data=Ping(3, 92, n).encode()) if frame.can_id == 205 else frame
        for n, frame in enumerate(commands()[i] for i in chosen)
    ]
    stream = [frame for frame in said_by(signer, said) if frame is not None]
    for what, where, value in meddlings:
        meddle(stream, what, where % max(1, len(stream)), value, [frame for frame in recorded if frame is not None])
    listener.hear(*stream)
    rest = iter(said)
    assert all(any(frame == one for one in rest) for frame in listener.believed)


def meddle(stream: list[Frame], what: str, at: int, value: int, recorded: list[Frame]) -> None:
    """Do something to a stream of frames."""
    if not stream:
        return
    frame = stream[at]
    match what:
        case "drop":
            del stream[at]
        case "double":
            stream.insert(min(len(stream), at + value % 8), frame)
        case "swap":
            other = (at + value) % len(stream)
            stream[at], stream[other] = stream[other], frame
        case "flip" if frame.data:
            data = bytearray(frame.data)
            data[value % len(data)] ^= 1 << at % 8
            stream[at] = frame._replace(data=bytes(data))
        case "cut":
            stream[at] = frame._replace(data=frame.data[: value % 8])
        case "replay":
            stream[at:at] = recorded[2 * (value % 6) :][:2]
        case "foreign":
            forged = commands(3 + value % 2)[value % 6]
            stream[at:at] = [forged, CommandSigner(FOREIGN, 126, 3).tag(forged) or forged]
        case "impostor":
            stream[at] = frame._replace(can_id=210 + frame.can_id % 10)
        case _:
            stream[at:at] = CommandSigner(FOREIGN, 126, 3).welcome(92, NONCE)
