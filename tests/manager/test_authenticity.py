"""A manager with a key: which of its frames have tags, and which states and commands of other nodes it accepts."""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any, cast

import pytest

from heronry_dg.loader import loads
from heronry_manager import events
from heronry_manager.core.authentication.nonce_answers import NonceAnswers
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.vocabulary import AskStatus, OperatorSaid, Reply
from heronry_wire.authentication import (
    NO_EMERGENCY,
    Key,
    Session,
)
from heronry_wire.command_tags import CommandSigner, CommandVerifier, Held
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Prepare,
    SliceBody,
    Step,
    is_welcome,
)
from heronry_wire.protocol_times import START_UP_WINDOW_NS
from heronry_wire.sansio import Received, Send
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
)
from lab.peers import ProvenStates, command_frame
from manager.one_manager import BEAT_NS, MS, NODE, SPEC_TEXT, OneManager

KEY, FOREIGN = Key(b"k" * 32), Key(b"f" * 32)
UNCONFIGURED = StatePage0(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, 1, 0, 0, 0)
LEFT = 92


class Pe(ProvenStates):
    """A PE that holds a key, as far as its states go."""

    def __init__(self, manager: OneManager, name: str = "left", key: Key = KEY, session: Session | None = None) -> None:
        super().__init__(manager.spec.pes[name].node_id, key, session)
        self.manager = manager

    def ask(self, drawn: int = 77) -> None:
        """Send a nonce, and take the answer if there is one."""
        nonce = KEY.nonce(self.node, drawn)
        before = len(self.manager.frames)
        self.manager.hear(Frame(state_id(self.node), StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce).encode()))
        verifier = CommandVerifier(KEY, BEAT_NS)
        for frame in self.manager.frames[before:]:
            if frame.can_id == management_id(NODE, Command.CONTROL):
                verifier.hold(NODE, Command.CONTROL, Received(0, frame), 0)
            elif isinstance(verifier.tagged(NODE, frame.data, 0, nonce), Held):
                self.session = Session(NODE, *verifier.places[NODE])

    def say(
        self, page: StatePage0 = UNCONFIGURED, session: Session | None = None, emergency: bytes = NO_EMERGENCY
    ) -> Frame:
        """Send a page 0, tagged, which proves an EMCY; gives the frame."""
        own, self.session = self.session, session or self.session
        frame = self.prove(page, emergency)
        self.session = own
        self.manager.hear(frame)
        return frame

    def stages(self, page: StatePage1) -> None:
        """Send a page 1, tagged."""
        self.manager.hear(self.prove(page))

    def reports(self, emergency: Emergency) -> bytes:
        """Send an EMCY."""
        self.manager.hear(Frame(emcy_id(self.node), emergency.encode()))
        return emergency.encode()

    def counts(self) -> bool:
        """Tell whether the manager has heard it lately."""
        return status(self.manager)["state"] in ("up", "suspect")


def changed(pe: Pe, **fields: Any) -> Pe:
    """The same PE, but for this."""
    other = copy(pe)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def status(manager: OneManager) -> dict[str, Any]:
    """Return what the status tells of the left PE."""
    (reply,) = [a for a in manager.give(OperatorSaid(1, AskStatus())) if isinstance(a, Reply)]
    assert reply.status is not None
    told: dict[str, Any] = reply.status["pes"]["left"]
    return told


def counts(manager: OneManager) -> tuple[bool, int, int]:
    """Tell whether the left PE is believed; the number of its states refused, and of its EMCYs that were not proven."""
    authentic = status(manager)["authentic"]
    assert authentic["refused_commands"] == 0
    return authentic["is_believed"], authentic["refused_states"], authentic["unproven_reports"]


def attacks(manager: OneManager) -> list[events.Attacked]:
    """Return the events that tell an attack."""
    return [event for event in manager.events if isinstance(event, events.Attacked)]


@pytest.fixture
def manager() -> OneManager:
    """Return a manager that has begun to send."""
    one = OneManager(key=KEY)
    one.pass_time(6 * BEAT_NS)
    return one


@pytest.fixture
def pe(manager: OneManager) -> Pe:
    """Return a PE that has been welcomed."""
    one = Pe(manager)
    one.ask()
    assert one.session is not None
    return one


def test_a_manager_that_fell_silent_waits_for_proof_as_at_its_start() -> None:
    manager = OneManager(key=KEY)
    manager.start(fly=False)
    manager.pass_time(START_UP_WINDOW_NS)
    for pe in manager.spec.pes:
        manager.die(pe)
    manager.pass_time(1_000 * MS)
    assert manager.of(events.HearsNobody)
    manager.live("left")
    begun_ns = manager.now_ns
    assert not manager.core.is_active
    manager.pass_time(200 * MS)
    assert manager.core.is_active
    requests = len(manager.requests)
    manager.pass_time(START_UP_WINDOW_NS - 300 * MS)
    assert (len(manager.requests), manager.core.is_active) == (requests, True)
    assert manager.now_ns - begun_ns < START_UP_WINDOW_NS


def test_no_nonce_is_answered_while_the_manager_only_listens_or_advises() -> None:
    listening = OneManager(key=KEY)
    pe = Pe(listening)
    pe.ask()
    assert pe.session is None
    advising = OneManager(key=KEY)
    advising.core = ManagerCore(advising.spec, NODE, NOTHING, advising.now_ns, advise=True, key=KEY)
    advising.pass_time(6 * BEAT_NS)
    pe = Pe(advising)
    pe.ask()
    assert pe.session is None
    assert advising.frames == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda pe: changed(pe, key=FOREIGN),
        lambda pe: changed(pe, session=Session(127, 1, pe.session.number)),
        lambda pe: changed(pe, session=Session(NODE, 1, pe.session.number - 1)),
        lambda pe: changed(pe, session=None),
    ],
    ids=["foreign", "for another manager", "from before", "untagged"],
)
def test_a_state_that_is_not_tagged_in_this_session_does_not_count(pe: Pe, spoil: Callable[[Pe], Pe]) -> None:
    spoil(pe).say()
    assert not pe.counts()


def test_a_replayed_state_does_not_keep_a_dead_pe_alive(manager: OneManager, pe: Pe) -> None:
    recorded = [pe.say() for _ in range(10)]
    for frame in recorded * 3:
        manager.pass_time(BEAT_NS)
        manager.hear(frame)
    assert not pe.counts()
    assert counts(manager) == (False, 30, 0)


def test_page_1_is_no_sign_of_life(manager: OneManager, pe: Pe) -> None:
    staged = StatePage1(PeState.UNCONFIGURED, PeFlags(0), 0, 0, Reason.NONE, 0)
    manager.hear(Frame(state_id(pe.node), staged.encode()))
    assert not pe.counts()


PENDING = replace(UNCONFIGURED, flags=PeFlags.FAULT_PENDING)
GYRO, CONTROL = (Emergency(FaultCode.REPORTED, 0x81, kind, 0, 7) for kind in (ElementKind.DEVICE, ElementKind.MODULE))


def latched(manager: OneManager) -> list[str]:
    """Elements that have been reported failed, by the manager's events."""
    return [event.element for event in manager.events if isinstance(event, events.FaultReported)]


def test_of_many_emcys_each_is_proven_by_a_state_of_its_own_and_a_forged_one_by_none(
    manager: OneManager, pe: Pe
) -> None:
    pe.say()
    forged = Emergency(FaultCode.REPORTED, 0x81, ElementKind.PE, 1, 0)
    said = [pe.reports(one) for one in (GYRO, forged, CONTROL)]
    pe.say(PENDING, emergency=said[2])
    pe.say(PENDING, emergency=said[0])
    pe.say()
    assert len(latched(manager)) == 2
    assert not any(element.startswith("pe:") for element in latched(manager))
    assert counts(manager) == (True, 0, 1)


def test_an_emcy_that_no_state_has_proven_is_forgotten_when_nothing_is_pending(manager: OneManager, pe: Pe) -> None:
    said = pe.reports(GYRO)
    pe.say()
    pe.say(PENDING, emergency=said)
    assert latched(manager) == []
    assert counts(manager) == (False, 1, 1)


def test_a_flood_of_emcys_pushes_out_the_oldest_and_is_bounded(manager: OneManager, pe: Pe) -> None:
    pe.say()
    for detail in range(1_000):
        pe.reports(replace(GYRO, detail=detail))
    said = pe.reports(GYRO)
    pe.say(PENDING, emergency=said)
    assert len(latched(manager)) == 1
    assert counts(manager) == (True, 0, 1_001 - 64)


def test_each_frame_of_an_emcy_counts_as_forged_unless_a_state_proves_it_and_codes_that_none_proves_do_not(
    manager: OneManager, pe: Pe
) -> None:
    pe.say()
    forged = replace(GYRO, detail=8)
    for one in (GYRO, forged, forged, *(replace(GYRO, code=FaultCode(code)) for code in (0, 0xFF0B, 0xFF0C, 0xFF0D))):
        said = pe.reports(one)
    manager.hear(Frame(emcy_id(LEFT), bytes(5)))
    pe.say(PENDING, emergency=GYRO.encode())
    pe.reports(GYRO)  # until the PE has heard that it is acknowledged
    assert counts(manager) == (True, 0, 0)
    pe.say()
    assert counts(manager) == (True, 0, 3)
    pe.say(PENDING, emergency=said)
    assert counts(manager) == (False, 1, 3)


@pytest.mark.parametrize("details", [1, 100], ids=["one EMCY again and again", "another EMCY each time"])
def test_a_tenth_of_the_bus_in_forged_emcys_is_told_as_an_attack(manager: OneManager, pe: Pe, details: int) -> None:
    pe.say()
    for frames_per_beat, is_told in ((5, False), (40, True)):
        for _ in range(1 + 1_000 * MS // BEAT_NS):
            for number in range(frames_per_beat):
                pe.reports(replace(GYRO, detail=number % details))
            manager.pass_time(BEAT_NS)
            pe.say()
        assert bool(attacks(manager)) is is_told
    (attack,) = attacks(manager)
    assert attack.percent >= 10
    assert attack.frames_per_s == pytest.approx(40 * 1_000 * MS / BEAT_NS, rel=0.2)
    assert latched(manager) == []


def test_true_emcys_whose_proofs_are_lost_are_no_attack(manager: OneManager, pe: Pe) -> None:
    pe.say()
    for number in range(3_000 * MS // BEAT_NS):
        pe.reports(replace(GYRO, detail=number // 10))
        manager.pass_time(BEAT_NS)
        if number % 10 == 9:
            pe.say()
    assert counts(manager)[2] > 0
    assert attacks(manager) == []
    pe.reports(GYRO)
    pe.say(PENDING, emergency=GYRO.encode())
    assert len(latched(manager)) == 1


def test_a_lost_channel_is_reported_as_it_is_heard_since_no_plan_depends_on_it() -> None:
    replicated = SPEC_TEXT.replace("bitrate: 1000000", "bitrate: 1000000, channels: 2")
    manager = OneManager(loads(replicated, "two_tails.dg.yaml"), key=KEY)
    manager.pass_time(6 * BEAT_NS)
    Pe(manager).reports(Emergency(FaultCode.CHANNEL_LOST, 0x11, ElementKind.CHANNEL, 0, 2))
    assert [event.channel for event in manager.events if isinstance(event, events.ChannelLost)] == ["can0.2"]


def test_what_an_older_mastership_commanded_is_known_by_what_page_3_names(manager: OneManager, pe: Pe) -> None:
    runs = StatePage0(PeState.ACTIVE, PeFlags(0), 1, 900, 0, 0xABCDEF)
    pe.say(runs)
    assert not pe.counts()
    named = StatePage3(PeState.ACTIVE, PeFlags(0), 0xABCDEF, 0, 0)
    for _ in range(2):
        manager.hear(Frame(state_id(pe.node), named.encode()))
    pe.say(runs)
    assert status(manager)["epoch"] == 900


def test_a_pe_that_lost_its_session_and_begins_anew_makes_no_event(manager: OneManager, pe: Pe) -> None:
    for _ in range(3):
        for _ in range(6):
            manager.pass_time(BEAT_NS)
            changed(pe, key=FOREIGN).say()
        pe.ask()
        pe.say()
        pe.say()
        assert status(manager)["authentic"]["is_believed"]
    assert told_unproven(manager) == []


def told_unproven(manager: OneManager) -> list[str]:
    return [event.pe for event in manager.events if isinstance(event, events.StatesUnproven)]


def lease_of(signer: CommandSigner, manager: int, term: int, epoch: int = 0, digest: int = 0) -> list[Frame]:
    """A LEASE of another manager, and its TAG."""
    step = Step.GO_ALL if epoch else Step.PREPARED
    frame = command_frame(Lease(term, epoch, step, digest), manager)
    tag = signer.tag(frame)
    assert tag is not None
    return [frame, tag]


@pytest.mark.parametrize(("key", "stops"), [(KEY, 1), (FOREIGN, 0)])
def test_another_manager_ends_a_mastership_only_with_the_key(manager: OneManager, key: Key, stops: int) -> None:
    for frame in lease_of(CommandSigner(key, 127, 9), 127, 9):
        assert manager.core.hears(frame.can_id)
        manager.hear(frame)
    assert len(manager.stops) == stops


@pytest.fixture
def advisor() -> OneManager:
    """Return a manager that only advises, beside an active one that has sent before; so it knows no session."""
    one = OneManager(key=KEY)
    one.core = ManagerCore(one.spec, 127, NOTHING, one.now_ns, advise=True, key=KEY)
    one.pass_time(6 * BEAT_NS)
    return one


def overheard_welcome(one: OneManager, signer: CommandSigner, drawn: int = 5, answered: int = 5) -> Session:
    """Let it hear a nonce of the left PE, other talk, the answer, and its TAG."""
    nonce, answered = KEY.nonce(LEFT, drawn), KEY.nonce(LEFT, answered)
    control, tag = signer.welcome(LEFT, answered)
    other = Frame(control.can_id, Control(signer.term, LEFT, Operation.ACKNOWLEDGE).encode())
    to_unknown, _ = CommandSigner(KEY, NODE, signer.term).welcome(125, answered)
    asks = Frame(state_id(LEFT), StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce).encode())
    for frame in (asks, asks, other, to_unknown, control, tag, tag):
        one.hear(frame)
    return Session(NODE, signer.term, signer.number)


def test_an_advising_manager_follows_a_welcome_of_another_manager(advisor: OneManager) -> None:
    pe = Pe(advisor, session=overheard_welcome(advisor, CommandSigner(KEY, NODE, 4)))
    pe.say()
    assert pe.counts()


@pytest.mark.parametrize(("key", "answered"), [(FOREIGN, 5), (KEY, 6)], ids=["another key", "another nonce"])
def test_an_advising_manager_does_not_follow_a_welcome_to_another_nonce_or_key(
    advisor: OneManager, key: Key, answered: int
) -> None:
    pe = Pe(advisor, session=overheard_welcome(advisor, CommandSigner(key, NODE, 4), answered=answered))
    pe.say()
    assert not pe.counts()


def test_an_older_welcome_that_is_replayed_takes_the_place_of_none(advisor: OneManager) -> None:
    signer = CommandSigner(KEY, NODE, 4)
    old = overheard_welcome(advisor, signer)
    pe = Pe(advisor, session=overheard_welcome(advisor, signer))
    pe.say()
    assert pe.counts()
    assert overheard_welcome(advisor, CommandSigner(KEY, NODE, 4)) == old
    advisor.pass_time(6 * BEAT_NS)
    pe.say(session=old)
    assert not pe.counts()


def test_an_active_manager_does_not_follow_a_welcome(manager: OneManager, pe: Pe) -> None:
    for number in range(3):
        manager.hear(CommandSigner(KEY, 127, 4 + number).welcome(LEFT, 5)[0])
    pe.say()
    assert pe.counts()


def test_a_standby_reads_states_by_the_digests_of_its_manager_and_tags_its_commands_when_it_takes_over() -> None:
    one = OneManager(node=127, key=KEY)
    one.core = ManagerCore(one.spec, 127, NOTHING, one.now_ns, key=KEY, standby=True)
    active_manager = CommandSigner(KEY, NODE, 3)
    for epoch in range(1, 9):
        for frame in lease_of(active_manager, NODE, 3, epoch, 1000 + epoch):
            one.hear(frame)
    pes = []
    for name, pe in one.spec.pes.items():
        nonce = KEY.nonce(pe.node_id, 5)
        one.hear(Frame(state_id(pe.node_id), StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce).encode()))
        for frame in active_manager.welcome(pe.node_id, nonce):
            one.hear(frame)
        pes.append(Pe(one, name, session=Session(NODE, 3, active_manager.number)))
    for epoch, runs in ((1, None), (8, 8)):
        for one_pe in pes:
            one_pe.say(StatePage0(PeState.ACTIVE, PeFlags(0), 1, epoch, 0, 1000 + epoch))
        assert status(one)["epoch"] == runs
    for _ in range(7):
        one.pass_time(BEAT_NS)
        for one_pe in pes:
            one_pe.say(StatePage0(PeState.ACTIVE, PeFlags(0), 1, 8, 0, 1008))
    assert [event.term for event in one.events if isinstance(event, events.TakenOver)] == [4]
    spoke, tag = one.frames[:2]
    assert CommandSigner(KEY, 127, 4).tag(spoke) == tag


def test_a_standby_takes_no_command_of_its_manager_for_an_attack() -> None:
    one = OneManager(node=127, key=KEY)
    one.core = ManagerCore(one.spec, 127, NOTHING, one.now_ns, key=KEY, standby=True)
    active_manager = CommandSigner(KEY, NODE, 3)
    messages = [SliceBody(LEFT, 2, number, b"12345") for number in range(1, 20)]
    deployed = [command_frame(message, NODE) for message in (Prepare(3, 2, 815), *messages)]
    for drawn in range(1 + 2_000 * MS // BEAT_NS):
        for frame in lease_of(active_manager, NODE, 3, 1, 1000):
            one.hear(frame)
        for frame in deployed:
            one.hear(frame)
            one.hear(cast("Frame", active_manager.tag(frame)))
        nonce = KEY.nonce(LEFT, drawn)
        one.hear(Frame(state_id(LEFT), StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce).encode()))
        for _ in range(10):
            for frame in active_manager.welcome(LEFT, nonce):
                one.hear(frame)
        one.pass_time(BEAT_NS)
    assert one.of(events.StandingBy)
    assert attacks(one) == []


def test_slices_leave_room_for_their_tags() -> None:
    plain, tagged = OneManager(), OneManager(key=KEY)
    assert plain.core._known.deployment.epochs.bitrate == 2 * tagged.core._known.deployment.epochs.bitrate


def test_alive_goes_out_as_without_a_key(manager: OneManager) -> None:
    assert Alive(1, 0, frozenset()) in manager.commands
    assert [a for a in manager.give(Received(0, Frame(5, b""))) if isinstance(a, Send)] == []
    assert manager.now_ns > MS


# Denial


def nonces_answered(manager: OneManager, *nonces: int) -> int:
    """Let a manager hear nonces of the left PE; gives how many it answers."""
    before = len(manager.frames)
    for nonce in nonces:
        manager.hear(Frame(state_id(LEFT), StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce).encode()))
    controls = [f for f in manager.frames[before:] if f.can_id == management_id(NODE, Command.CONTROL)]
    return len([f for f in controls if is_welcome(f.data)])


def test_forged_nonces_are_not_answered_and_keep_no_true_one_from_its_answer(manager: OneManager, pe: Pe) -> None:
    assert nonces_answered(manager, *range(1, 50), KEY.nonce(93, 1), FOREIGN.nonce(LEFT, 1)) == 0
    assert nonces_answered(manager, KEY.nonce(LEFT, 1)) == 1
    pe.say()
    assert pe.counts()  # in the session that it had


def test_recorded_nonces_are_answered_for_a_while_and_a_few_at_once(manager: OneManager, pe: Pe) -> None:
    recorded = [KEY.nonce(pe.node, drawn) for drawn in range(1, 7)]
    manager.pass_time(BEAT_NS)
    assert nonces_answered(manager, *recorded) == 4
    manager.pass_time(BEAT_NS)
    assert nonces_answered(manager, *recorded[4:], recorded[4]) == 2
    for _ in range(11):
        manager.pass_time(BEAT_NS)
    assert nonces_answered(manager, *recorded) == 0
    assert nonces_answered(manager, KEY.nonce(pe.node, 7)) == 1


def test_a_manager_forgets_the_oldest_nonces() -> None:
    answers = NonceAnswers(BEAT_NS)
    assert answers.is_due(1, 0)
    for drawn in range(2, 300):
        answers.is_due(drawn, drawn * BEAT_NS)
    assert answers.is_due(1, 300 * BEAT_NS)


def test_a_tenth_of_the_bus_is_told_as_an_attack_once(manager: OneManager, pe: Pe) -> None:
    for frames_per_beat, told in ((5, 0), (40, 1), (40, 1), (2, 1), (40, 2)):
        for _ in range(1 + 1_000 * MS // BEAT_NS):
            nonces_answered(manager, *range(1, frames_per_beat))
            manager.pass_time(BEAT_NS)
            pe.say()
        assert len(attacks(manager)) == told
    assert attacks(manager)[0].bus == "can0"
    assert attacks(manager)[0].percent >= 10
