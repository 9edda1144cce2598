"""What checkpoints take of a bus in a simulated flight, against what `heronry bus` says of it; and its oracle."""

from pathlib import Path

import cantools
import pytest

from heronry_dg.bus_schedule import bus_schedules
from heronry_dg.loader import load
from heronry_dg.situation import situation
from heronry_manager.events import StateLacking, StateRestored
from heronry_manager.planner.exact import plan
from heronry_tools.reports.dbc import dbc_text
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.checkpoints import CheckpointCheck
from heronry_tools.sim.world.steps_seen import StateSeen
from heronry_wire.checkpoint_frames import SentState
from heronry_wire.identifiers import Use, classify
from heronry_wire.timing import exact_bits

SPEC = load(Path("dg_specs/examples/kept_state.dg.yaml"))
S = 1_000_000_000
WORST_BITS = 135  # of a frame of 8 bytes with a standard identifier


@pytest.mark.parametrize("down", [(), ("pe:left",), ("pe:right",)])
def test_a_bus_carries_the_frames_that_are_foretold(down: tuple[str, ...]) -> None:
    now = situation(SPEC, down=down)
    (schedule,) = bus_schedules(SPEC, now, plan(SPEC, now).configuration)
    told = [one for one in schedule.messages if one.kind == "checkpoint"]
    frames_per_s = sum(one.bits / WORST_BITS * S / one.period_ns for one in told)
    flight = Simulation(SPEC, keep_trace=True, absent=[element.removeprefix("pe:") for element in down])
    flight.run_until(9 * S)  # the start-up window of an absent PE has ended
    begin_ns = flight.now_ns
    flight.run_until(begin_ns + 20 * S)
    sent = [
        one.frame for one in flight.trace if one.end_ns > begin_ns and classify(one.frame.can_id).use is Use.CHECKPOINT
    ]
    assert len(sent) / 20 == pytest.approx(frames_per_s, rel=0.02)
    assert sum(exact_bits(frame) for frame in sent) / 20 <= frames_per_s * WORST_BITS
    assert bool(told) is not bool(down)


# The oracle


def seen(
    t_s: float,
    *,
    is_saved: bool,
    data: bytes = b"state",
    pe: str = "left",
    code: str = "1",
    number: int = 7,
    age_s: float = 2.0,
) -> StateSeen:
    return StateSeen(round(t_s * S), pe, "pitch_trim", is_saved, data, code, number, round(age_s * S))


SAVED = seen(1.0, is_saved=True)


@pytest.mark.parametrize(
    ("restored", "says"),
    [
        (seen(1.9, is_saved=False, pe="right"), None),
        (seen(2.1, is_saved=False, pe="right"), "from a state that is 1100.0 ms old, but may be 1000 ms old"),
        (seen(1.5, is_saved=False, data=b"stat"), "from 73746174, which it has never saved"),
        (seen(1.5, is_saved=False, age_s=0.5), None),
        (seen(1.5, is_saved=False, age_s=0.4), "from a state that is 500.0 ms old, and is told 400.0 ms"),
        (seen(1.5, is_saved=False, number=8), "from 7374617465, which it has never saved"),
        (seen(1.5, is_saved=False, code="2"), "from a state of another version of its code"),
    ],
)
def test_a_start_is_judged_by_what_was_saved(restored: StateSeen, says: str | None) -> None:
    oracle = CheckpointCheck(SPEC)
    oracle.state_seen(SAVED)
    oracle.state_seen(restored)
    found = [one.story for one in oracle.violations]
    assert found == ([] if says is None else [f"pitch_trim on {restored.pe} starts {says}"])


def test_equal_bytes_of_a_later_round_make_a_state_no_younger() -> None:
    oracle = CheckpointCheck(SPEC)
    for one in (SAVED, seen(2.0, is_saved=True, number=8), seen(2.1, is_saved=False, pe="right")):
        oracle.state_seen(one)
    (violation,) = oracle.violations
    assert violation.story == "pitch_trim on right starts from a state that is 1100.0 ms old, but may be 1000 ms old"


def test_a_state_is_used_once_on_a_pe() -> None:
    oracle = CheckpointCheck(SPEC)
    for one in (SAVED, seen(1.5, is_saved=False), seen(1.6, is_saved=False, pe="right"), seen(1.7, is_saved=False)):
        oracle.state_seen(one)
    (violation,) = oracle.violations
    assert violation.story == "pitch_trim on left starts from a state from which it has started there before"


def moved_to_other_code() -> Simulation:
    """A flight in which the modules move to a PE that has another version of their code."""
    flight = Simulation(SPEC)
    for module in ("pitch_filter", "pitch_trim"):
        flight.fleet.change_code("right", module)
    flight.run_until(4 * S)
    assert not [one for one in flight.events if isinstance(one, StateRestored)]
    flight.fleet.kill("left")
    flight.run_until(6 * S)
    return flight


def test_a_state_of_another_version_of_the_code_is_not_used() -> None:
    flight = moved_to_other_code()
    lacking = {(one.module, one.by, one.why) for one in flight.events if isinstance(one, StateLacking)}
    why = "its state is of another version of its code, or damaged"
    assert {("pitch_filter", "right", why), ("pitch_trim", "right", why)} <= lacking
    assert flight.broken() == []


def test_the_oracle_finds_a_state_of_another_version_of_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SentState, "is_of", lambda *_: True)
    found = {one.story for one in moved_to_other_code().broken()}
    assert found == {
        f"{name} on right starts from a state of another version of its code" for name in ("pitch_filter", "pitch_trim")
    }


def test_a_dbc_names_the_fields_of_each_frame() -> None:
    database = cantools.database.load_string(dbc_text(SPEC), "dbc")
    assert [m.name for m in database.messages if "CHECKPOINT" in m.name] == ["CHECKPOINT_left", "CHECKPOINT_right"]
    head, part = SentState.of(1, 9, b"12345", b"8 bytes.").frames(92)
    told = database.decode_message(head.can_id, head.data)
    assert (told["module"], told["round"], told["frame"], told["length"]) == (1, 9, 0, 5)
    assert database.decode_message(part.can_id, part.data)["state"] == int.from_bytes(b"12345", "big")
