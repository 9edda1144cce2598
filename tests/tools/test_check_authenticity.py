"""The oracle of authenticity: it finds a PE that accepts a command that is not authentic and fresh, and no other PE."""

from itertools import pairwise

import pytest

from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.flight.outcome import KEY
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.authenticity import AuthenticityCheck
from heronry_tools.sim.oracles.proven_commands import ProvenCommands
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.authentication import NO_NONCE, Key, Place, next_number
from heronry_wire.command_tags import CommandSigner, CommandVerifier, Held
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    COMMAND_OF,
    NUMBER_SPAN,
    TAG,
    Activate,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Operation,
    Prepare,
    SliceHead,
    Step,
)
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1, StatePage2
from lab.peers import command_frame

SPEC = load_spec("elevator_and_chute")
NODE = SPEC.pes["tail_pe"].node_id
MS = 1_000_000


class Bus:
    """An oracle, and what it is shown."""

    def __init__(self) -> None:
        self.check = AuthenticityCheck(SPEC, KEY)
        self.now_ns = 1000 * MS
        self.signer = CommandSigner(KEY, 126, 1)
        self.pe_sends(PeState.UNCONFIGURED, 0)

    def show(self, frame: Frame, sender: str = "manager 126", bus: str = "can0") -> None:
        self.check.seen(Sent(self.now_ns, bus, sender, frame))

    def say(self, message: ManagementMessage) -> tuple[Frame, Frame]:
        """A true command."""
        frame = Frame(management_id(126, COMMAND_OF[type(message)]), message.encode())
        tag = self.signer.tag(frame)
        assert tag is not None
        self.repeat((frame, tag))
        return frame, tag

    def repeat(self, pair: tuple[Frame, Frame]) -> None:
        for frame in pair:
            self.show(frame, f"{STRANGER}forger")

    def pe_sends(self, state: PeState, epoch: int, *, hears: bool = False, incarnation: int = 1) -> None:
        page = StatePage0(state, PeFlags.HEARS_LEASE if hears else PeFlags(0), incarnation, epoch, 0, 7)
        self.show(Frame(state_id(NODE), page.encode()), "tail_pe")

    def pe_stages(self, epoch: int) -> None:
        page = StatePage1(PeState.ACTIVE, PeFlags(0), epoch, 0, Reason.NONE, 0)
        self.show(Frame(state_id(NODE), page.encode()), "tail_pe")

    def pe_withdraws(self, index: int) -> None:
        said = Emergency(FaultCode.RESET, 0, ElementKind.MODULE, index, 0)
        self.show(Frame(emcy_id(NODE), said.encode()), "tail_pe")

    @property
    def stories(self) -> list[str]:
        assert {violation.rule for violation in self.check.violations} <= {"authentic"}
        return [violation.story for violation in self.check.violations]


def test_a_pe_that_does_what_a_holder_of_the_key_commands_breaks_nothing() -> None:
    bus = Bus()
    bus.say(Prepare(1, 1, 7))
    bus.pe_stages(1)
    bus.say(Activate(1, 1, Step.BREAK, 7))
    bus.pe_sends(PeState.BROKEN, 1)
    bus.say(Lease(1, 1, Step.GO_ALL, 7))
    bus.pe_sends(PeState.ACTIVE, 1, hears=True)
    bus.say(Control(1, 0, Operation.CLEAR, ElementKind.MODULE, 3))
    bus.pe_withdraws(3)
    assert bus.stories == []


def test_an_epoch_that_no_holder_of_the_key_has_prepared_is_found() -> None:
    bus = Bus()
    forged = command_frame(Prepare(1, 1, 7))
    bus.repeat((forged, Frame(management_id(126, Command.TAG), TAG.pack(Command.PREPARE, 0, 12345))))
    bus.pe_stages(1)
    assert bus.stories == ["tail_pe has staged epoch 1, which no holder of the key has prepared"]


def test_a_step_that_was_not_commanded_yet_is_found_once() -> None:
    bus = Bus()
    bus.say(Activate(1, 1, Step.BREAK, 7))
    bus.pe_sends(PeState.BROKEN, 1)
    for _ in range(2):
        bus.pe_sends(PeState.ACTIVE, 1)
    assert bus.stories == ["tail_pe is ACTIVE in epoch 1, which no holder of the key has commanded"]


def test_a_pe_that_starts_anew_has_heard_nothing_of_what_was_sent_before() -> None:
    bus = Bus()
    pair = bus.say(Lease(1, 1, Step.GO_ALL, 7))
    bus.now_ns += 30 * MS
    bus.pe_sends(PeState.UNCONFIGURED, 0, incarnation=2)
    for _ in range(20):
        bus.repeat(pair)
        bus.now_ns += 20 * MS
        bus.pe_sends(PeState.ACTIVE, 1, hears=True, incarnation=2)
    assert len(bus.stories) == 2


@pytest.mark.parametrize("may_count_again", [True, False])
def test_a_manager_that_has_lost_its_term_counts_in_it_again(may_count_again: bool) -> None:
    bus = Bus()
    for _ in range(2):
        bus.say(Lease(1, 1, Step.GO_ALL, 7))
    bus.now_ns += 100 * MS
    if may_count_again:
        bus.check.may_count_again()
    bus.signer = CommandSigner(KEY, 126, 1)
    bus.pe_sends(PeState.UNCONFIGURED, 0, incarnation=2)
    bus.say(Activate(1, 1, Step.GO_ALL, 7))
    bus.pe_sends(PeState.ACTIVE, 1, incarnation=2)
    assert bus.stories == (
        [] if may_count_again else ["tail_pe is ACTIVE in epoch 1, which no holder of the key has commanded"]
    )


def test_a_pe_that_is_welcomed_before_its_first_page_0_may_have_heard_what_was_sent_just_before() -> None:
    bus = Bus()
    bus.say(Prepare(1, 1, 7))
    bus.now_ns += 500 * MS
    bus.say(Lease(1, 2, Step.GO, 7))
    bus.say(Prepare(1, 2, 7))
    bus.say(Control(1, 0, Operation.CLEAR, ElementKind.MODULE, 3))
    bus.now_ns += 20 * MS
    bus.pe_sends(PeState.UNCONFIGURED, 0, hears=True, incarnation=2)
    bus.pe_stages(2)
    bus.pe_sends(PeState.PARTIAL, 2, hears=True, incarnation=2)
    bus.pe_withdraws(3)
    assert bus.stories == []
    bus.pe_stages(1)
    assert len(bus.stories) == 1


def test_a_pe_whose_transmitter_failed_at_its_start_may_have_heard_what_was_sent_since_its_page_2() -> None:
    bus = Bus()
    bus.say(Prepare(1, 1, 7))
    bus.now_ns += 500 * MS
    for nonce in (5, 6):
        bus.show(Frame(state_id(NODE), StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce).encode()), "tail_pe")
        bus.say(Prepare(1, 2, 7))
        bus.now_ns += 500 * MS
    bus.pe_sends(PeState.UNCONFIGURED, 0, incarnation=2)
    bus.pe_stages(2)
    assert bus.stories == []
    bus.pe_stages(1)
    assert len(bus.stories) == 1


def test_a_dead_manager_that_is_replayed_is_found() -> None:
    bus = Bus()
    said = []
    for _ in range(6):
        said.append(bus.say(Lease(1, 1, Step.GO_ALL, 7)))
        bus.now_ns += 20 * MS
        bus.pe_sends(PeState.ACTIVE, 1, hears=True)
    for _ in range(300):
        bus.repeat(said[_ % 6])
        bus.now_ns += 20 * MS
        bus.pe_sends(PeState.ACTIVE, 1, hears=True)
    assert bus.stories == ["tail_pe reports that it hears a LEASE, but no authentic and fresh one was sent"]


def test_a_late_lease_may_still_be_believed_once() -> None:
    bus = Bus()
    bus.say(Lease(1, 1, Step.GO_ALL, 7))
    bus.pe_sends(PeState.ACTIVE, 1, hears=True)
    missed = bus.say(Lease(1, 1, Step.GO_ALL, 7))
    bus.now_ns += 500 * MS
    bus.pe_sends(PeState.ACTIVE, 1)
    bus.repeat(missed)
    bus.pe_sends(PeState.ACTIVE, 1, hears=True)
    assert bus.stories == []


def test_a_fault_is_not_withdrawn_for_an_old_clear() -> None:
    bus = Bus()
    bus.say(Control(1, 0, Operation.CLEAR, ElementKind.MODULE, 3))
    bus.now_ns += 900 * MS
    bus.pe_withdraws(3)
    bus.pe_withdraws(4)
    assert [story.split(",")[0] for story in bus.stories] == [
        "tail_pe withdraws its report of module 3",
        "tail_pe withdraws its report of module 4",
    ]


def test_a_fault_cleared_on_one_pe_is_withdrawn_there_alone() -> None:
    bus = Bus()
    bus.say(Control(1, 0, Operation.CLEAR, ElementKind.MODULE | NODE << 8, 3))
    bus.say(Control(1, 0, Operation.CLEAR, ElementKind.MODULE | (NODE + 1) << 8, 4))
    bus.pe_withdraws(3)
    assert bus.stories == []
    bus.pe_withdraws(4)
    assert [story.split(",")[0] for story in bus.stories] == ["tail_pe withdraws its report of module 4"]


def test_two_managers_are_believed_each_by_its_own_numbers() -> None:
    bus = Bus()
    bus.say(Lease(1, 1, Step.GO_ALL, 7))
    other = CommandSigner(KEY, 127, 2)
    frame = command_frame(Lease(2, 1, Step.GO_ALL, 7), 127)
    tag = other.tag(frame)
    assert tag is not None
    bus.repeat((frame, tag))
    bus.pe_sends(PeState.ACTIVE, 1, hears=True)
    assert bus.stories == []


def test_a_frame_of_another_bus_or_a_stranger_or_without_sense_shows_nothing() -> None:
    bus = Bus()
    page = StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 1, 1, 0, 7)
    bus.show(Frame(state_id(NODE), page.encode()), f"{STRANGER}forger")
    bus.show(Frame(state_id(NODE), page.encode()), "tail_pe", bus="radio")
    bus.show(Frame(state_id(NODE), b"\xff"), "tail_pe")
    bus.show(Frame(emcy_id(NODE), b""), "tail_pe")
    bus.show(Frame(emcy_id(NODE), Emergency(FaultCode.REPORTED, 1, ElementKind.MODULE, 1, 0).encode()), "tail_pe")
    bus.show(Frame(700, b"\x01"))
    assert bus.stories == []


def test_a_proof_needs_a_command_its_tag_and_a_number_that_is_not_too_far_ahead() -> None:
    proven = ProvenCommands(KEY)

    def take(frame: Frame) -> Place | None:
        found = proven.take(Sent(0, "can0", "x", frame))
        return None if found is None else found.place

    signer = CommandSigner(KEY, 127, 2)
    lease = command_frame(Lease(2, 0, Step.PREPARED, 0), 127)
    tags = [signer.tag(lease) for _ in range(3)]
    assert proven.newest(127) == Place(0, 0)
    assert take(tags[0] or lease) is None  # no command has come
    take(lease)
    take(lease)
    assert [take(tag or lease) for tag in tags[:2]] == [Place(2, 0), Place(2, 1)]
    take(Frame(management_id(127, Command.LEASE), b"\x00"))
    assert take(tags[2] or lease) is None
    slice_head = command_frame(SliceHead(NODE, 1, 0, 0), 127)
    take(slice_head)
    assert take(signer.tag(slice_head) or slice_head) is None
    assert take(Frame(management_id(127, Command.TAG), b"\x00")) is None
    assert proven.newest(127) == Place(2, 1)
    signer.number = 2 * NUMBER_SPAN
    take(lease)
    assert take(signer.tag(lease) or lease) is None


# Broken cores


def believes_whatever_is_tagged(
    self: CommandVerifier, manager: int, data: bytes, _arrived_ns: int, _nonce: int = NO_NONCE
) -> object:
    """Does not look at the tag."""
    kind, low, _ = TAG.unpack(data) or (0, 0, 0)
    held = self._held[manager, kind]
    if not held:
        return FIND(self, manager, data, _arrived_ns, _nonce)
    found: Held = held.popleft()
    term = int.from_bytes(found.event.frame.data[:2], "big")
    self.places[manager] = Place(term >> 4 if kind == Command.PREPARE else term, low)
    return found


def forgets_the_last_number(self: CommandVerifier, manager: int, kind: int, payload: bytes, low: int) -> object:
    """Takes every number for a new one."""
    place = PLACE(self, manager, kind, payload, low)
    last = self.places.get(manager)
    if last is None or kind == 7:
        return place
    term = last.term if kind == Command.SLICE else int.from_bytes(payload[:2], "big") >> (4 if kind == 2 else 0)
    return Place(term, next_number(-1, low, NUMBER_SPAN))


FIND, PLACE = CommandVerifier._find, CommandVerifier._place


def led_by_a_stranger(*, forges: bool) -> list[str]:
    """Rules that are broken when the manager has died, and a stranger sends its LEASEs again, or with any tag."""
    simulation = Simulation(SPEC, 1, key=KEY, keep_trace=True)
    simulation.run_for(1500 * MS)
    ids = (management_id(126, Command.LEASE), management_id(126, Command.TAG))
    said = [sent.frame for sent in simulation.trace if sent.frame.can_id in ids and sent.sender == "manager 126"]
    pairs = [(one, two) for one, two in pairwise(said) if (one.can_id, two.can_id) == ids]
    simulation.managers.kill()
    bus = simulation.wiring.buses["can0"]
    station = bus.join(f"{STRANGER}parrot", 0, lambda _: None, ())
    for number in range(100):
        lease, tag = pairs[-1 - number % 40]
        bus.offer(station, lease)
        bus.offer(station, tag._replace(data=tag.data[:2] + bytes(6)) if forges else tag)
        simulation.run_for(20 * MS)
    return [violation.rule for violation in simulation.broken()]


@pytest.mark.parametrize(
    ("bus", "sender", "lies"),
    [
        ("can0", "comms", False),
        ("radio", f"{STRANGER}twin", False),
        ("radio", "comms", False),
        ("radio", "ground", True),
    ],
)
def test_a_pe_beyond_a_gateway_has_sent_only_what_it_sent_there_itself(bus: str, sender: str, lies: bool) -> None:
    spec = load_spec("big_blue")
    check, page = AuthenticityCheck(spec, KEY), StatePage1(PeState.ACTIVE, PeFlags(0), 9, 0, Reason.NONE, 0)
    check.seen(Sent(MS, bus, sender, Frame(state_id(spec.pes["ground"].node_id), page.encode())))
    assert bool(check.violations) == lies


@pytest.mark.parametrize("forges", [True, False])
def test_a_pe_that_keeps_to_the_rules_breaks_none_whatever_a_stranger_sends(forges: bool) -> None:
    assert led_by_a_stranger(forges=forges) == []


@pytest.mark.parametrize(
    ("part", "broken", "forges"),
    [("_find", believes_whatever_is_tagged, True), ("_place", forgets_the_last_number, False)],
)
def test_a_pe_that_believes_what_is_forged_or_replayed_is_found(
    part: str, broken: object, forges: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CommandVerifier, part, broken)
    assert "authentic" in led_by_a_stranger(forges=forges)


def test_another_key_proves_nothing() -> None:
    proven = ProvenCommands(Key(bytes(range(32))))
    signer = CommandSigner(KEY, 126, 1)
    lease = command_frame(Lease(1, 0, Step.PREPARED, 0))
    proven.take(Sent(0, "can0", "x", lease))
    assert proven.take(Sent(0, "can0", "x", signer.tag(lease) or lease)) is None
