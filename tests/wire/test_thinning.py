"""Thinned states: what is new passes at once, a sign of life passes often enough, the rest does not."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.state_frames import NEWS_MASK, PeFlags, PeState, StatePage0
from heronry_wire.thinning import REFRESH_NS, Thinned, Thinning

MS = 1_000_000
PERIOD_NS = 20 * MS
EVERY_NS = 30 * MS
LEFT, RIGHT, LEASE, OTHER = 257, 258, 200, 300
GROUP = Thinned(frozenset((LEFT, RIGHT)), frozenset((LEASE,)), NEWS_MASK, EVERY_NS)


def state(sequence: int, epoch: int = 7, digest: int = 1) -> bytes:
    return StatePage0(PeState.ACTIVE, PeFlags(0), 1, epoch, sequence, digest).encode()


def test_repetitions_pass_only_as_signs_of_life() -> None:
    thinning = Thinning(GROUP)
    passed = [at for at in range(20) if not thinning.drops(LEFT, state(at, digest=at), at * PERIOD_NS)]
    assert passed == list(range(0, 20, 2)), "the sequence and the tag are nothing new"


def test_a_change_passes_at_once_and_so_does_the_first_state_of_each_node() -> None:
    thinning = Thinning(GROUP)
    assert not thinning.drops(LEFT, state(0), 0)
    assert not thinning.drops(RIGHT, state(0), MS)
    assert thinning.drops(LEFT, state(1), 2 * MS)
    assert not thinning.drops(LEFT, state(2, epoch=8), 3 * MS)
    assert not thinning.drops(LEFT, state(2)[:7], 4 * MS), "also where it is malformed"


def test_another_sign_of_life_makes_states_needless_except_for_a_refresh() -> None:
    thinning, passed = Thinning(GROUP), []
    for at_ns in range(0, 3 * REFRESH_NS, PERIOD_NS):
        assert not thinning.drops(LEASE, bytes(8), at_ns)
        passed += [at_ns] * (not thinning.drops(LEFT, state(at_ns // PERIOD_NS % 256), at_ns + MS))
    assert passed == [0, REFRESH_NS, 2 * REFRESH_NS]


def test_other_identifiers_are_left_alone() -> None:
    thinning = Thinning(GROUP)
    assert [thinning.concerns(one) for one in (LEFT, LEASE, OTHER)] == [True, True, False]
    assert not any(thinning.drops(OTHER, bytes(8), at_ns) for at_ns in range(5))


def test_a_forger_with_ever_new_content_fills_no_memory() -> None:
    thinning = Thinning(GROUP)
    assert not any(thinning.drops(LEFT, state(0, epoch=epoch), epoch) for epoch in range(5_000))
    assert len(thinning._passed_ns) <= 512


@given(st.lists(st.tuples(st.sampled_from((LEFT, RIGHT)), st.integers(5, 7), st.integers(0, 60 * MS)), max_size=80))
def test_nothing_new_is_ever_missed_and_the_last_sign_is_never_old(story: list[tuple[int, int, int]]) -> None:
    thinning, now_ns, known, sign_ns = Thinning(GROUP), 0, dict[tuple[int, int], int](), None
    for can_id, epoch, later_ns in story:
        now_ns += later_ns
        is_new = now_ns - known.get((can_id, epoch), -REFRESH_NS) >= REFRESH_NS
        is_sign = sign_ns is None or now_ns - sign_ns >= EVERY_NS
        drops = thinning.drops(can_id, state(0, epoch=epoch), now_ns)
        assert drops == (not is_new and not is_sign)
        if not drops:
            known[can_id, epoch] = sign_ns = now_ns
