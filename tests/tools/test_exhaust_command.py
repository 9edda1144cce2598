"""Every single fault at every message of every reconfiguration: a sample of them flown, and what the command tells."""

import json
import shlex
from functools import cache
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_tools.cli import main
from heronry_tools.commands import exhaust as exhaust_command
from heronry_tools.sim.flight.exhaustive import KINDS, PLAIN, Setup, begin, single_cases, stories
from heronry_tools.sim.world.bus import Sent
from heronry_wire.identifiers import MANAGER_NODES, Command, management_id
from heronry_wire.management import Control, Operation, decode_command
from scenarios.flights import MS, big_blue
from thoroughness import part_of

FILE = Path("dg_specs/examples/demux_actuators.dg.yaml")
PHASES = Path("dg_specs/examples/phases.dg.yaml")
HOWS = ["--standby", "--keyed --foreseen 1", "--standby --keyed --foreseen 1"]


def test_every_story_that_reconfigures_gets_every_frame_fault_at_every_node() -> None:
    spec = load(FILE)
    cases = {story: single_cases(spec, story) for story in stories(spec)}
    idle = {story for story, found in cases.items() if not found}
    assert idle == {"raise module:servo_driver_2", "clear module:servo_driver_2"}  # it does not run
    faults = {(fault.kind, fault.victim) for found in cases.values() for case in found for fault in case.faults}
    nodes = {"manager", "pe:flight", "pe:tail_a", "pe:tail_b"}
    assert {kind for kind, _ in faults} == set(KINDS) - {"cut"}
    assert {victim for kind, victim in faults if kind == "lost"} == nodes | {"everybody"}
    assert {victim for kind, victim in faults if kind == "crash"} == nodes
    assert sum(map(len, cases.values())) > 30_000


def test_with_tables_a_blank_node_and_a_retirement_are_stories_and_a_pe_may_be_cut_off() -> None:
    spec, tables = load(FILE), Setup(tables=True)
    assert stories(spec, tables) == [f"{what} pe:{pe}" for what in ("blank", "retire", "restore") for pe in spec.pes]
    cases = {story: single_cases(spec, story, tables) for story in ("blank pe:tail_a", "retire pe:tail_a")}
    for found in cases.values():
        faults = {(fault.kind, fault.victim) for case in found for fault in case.faults}
        assert {kind for kind, _ in faults} == set(KINDS)
        assert {victim for kind, victim in faults if kind == "cut"} == {f"pe:{pe}" for pe in spec.pes}
    assert len(cases["blank pe:tail_a"]) > 5 * len(cases["retire pe:tail_a"])  # the segments of its table


def test_with_two_managers_a_takeover_is_a_story_and_either_of_them_is_a_victim() -> None:
    spec, two = load(FILE), Setup(standby=True)
    assert stories(spec, two) == [*stories(spec), "takeover"]
    faults = {(fault.kind, fault.victim) for case in single_cases(spec, "takeover", two) for fault in case.faults}
    assert {victim for kind, victim in faults if kind == "crash"} == {
        "primary",
        "standby",
        *(f"pe:{p}" for p in spec.pes),
    }
    assert {victim for kind, victim in faults if kind == "death"} == {"primary", *(f"pe:{pe}" for pe in spec.pes)}


def test_cases_with_a_key_plans_on_board_and_two_managers_end_well(capsys: pytest.CaptureFixture[str]) -> None:
    cases = ["takeover: 3 lost everybody", "crash pe:tail_a: 2 crash primary", "return pe:tail_a: 3 doubled everybody"]
    words = [*HOWS[-1].split(), *(word for case in cases for word in ("--case", case))]
    assert main(["exhaust", str(FILE), *words]) == 0
    assert capsys.readouterr().out.endswith("0 failed\n")


@pytest.mark.soak  # to draw them, every story is flown; in every run those above and test_a_sample_of_singles_and_pairs
@pytest.mark.parametrize("how", HOWS)
def test_a_sample_with_a_key_plans_on_board_or_two_managers(how: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            [
                "exhaust",
                str(FILE),
                "--sample",
                "14",
                "--pairs",
                "6",
                "--seed",
                "9",
                *how.split(),
            ]
        )
        == 0
    )
    assert capsys.readouterr().out.endswith("0 failed\n")


def test_phases_are_stories_too_by_the_operator_and_by_a_module() -> None:
    assert [story for story in stories(big_blue()) if story.startswith(("phase", "request"))] == [
        f"{what} {phase}" for what in ("phase", "request") for phase in big_blue().phases
    ]


@pytest.mark.parametrize(
    ("file", "story", "told"),
    [
        (FILE, "dead device:horizon_sensor", {Operation.ACKNOWLEDGE, Operation.HOLDS}),
        (FILE, "fail pe:tail_a", {Operation.HOLDS}),
        (FILE, "clear device:elevator_servo_1", {Operation.CLEAR}),
        (FILE, "clear module:elevator_control", {Operation.CLEAR}),
        (PHASES, "request glide", {Operation.ACKNOWLEDGE, Operation.HOLDS}),
    ],
)
def test_frames_about_faults_and_orders_get_frame_faults_too(file: Path, story: str, told: set[Operation]) -> None:
    spec, heard = load(file), set[Operation]()
    simulation = PLAIN.take_off(spec)
    controls = {management_id(node, Command.CONTROL) for node in MANAGER_NODES}

    def hear(sent: Sent) -> None:
        message = decode_command(Command.CONTROL, sent.frame.data) if sent.frame.can_id in controls else None
        heard.update((message.operation,) if isinstance(message, Control) else ())

    begin(simulation, story)
    simulation.wiring.tap("can0", hear)
    simulation.run_for(2_000 * MS)
    assert heard >= told


@pytest.mark.parametrize(
    ("file", "cases"),
    [
        (FILE, ["dead device:horizon_sensor: 30 lost everybody", "fail pe:tail_a: 1 lost everybody"]),
        (FILE, ["clear module:elevator_control: 0 lost pe:flight", "clear pe:flight: 0 crash manager"]),
        (PHASES, ["request glide: 0 lost manager", "request glide: 1 crash manager"]),
    ],
)
def test_faults_and_orders_are_flown(file: Path, cases: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exhaust", str(file), *(word for case in cases for word in ("--case", case))]) == 0
    assert capsys.readouterr().out.endswith("0 failed\n")


def test_what_there_is_can_be_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    known = cache(lambda story: single_cases(load(PHASES), story))  # flown once for both forms
    monkeypatch.setattr(exhaust_command, "single_cases", lambda _, story, _setup=PLAIN: known(story))
    assert main(["exhaust", str(PHASES), "--count"]) == 0
    *counts, whole = capsys.readouterr().out.splitlines()
    assert [line.split(maxsplit=1)[1] for line in counts] == stories(load(PHASES))
    assert whole == f"{sum(int(line.split()[0]) for line in counts):7} flights"
    assert main(["exhaust", str(PHASES), "--count", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [f"{count:7} {story}" for story, count in told["stories"].items()] == counts
    assert f"{told['flights']:7} flights" == whole


def test_a_sample_of_singles_and_pairs_leaves_everything_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    singles, pairs = part_of(35, 12), part_of(15, 15)
    assert main(["exhaust", str(FILE), "--sample", str(singles), "--pairs", str(pairs), "--seed", "3"]) == 0
    out = capsys.readouterr().out
    assert f" {singles + pairs} flights (" in out
    assert out.endswith("0 failed\n")


def test_cases_are_flown_as_they_are_written_and_in_parallel_alike(capsys: pytest.CaptureFixture[str]) -> None:
    cases = ["start: 3 lost everybody", "return pe:tail_a: 40 late-30 manager, 44 crash pe:tail_a"]
    cases.append("crash pe:tail_a: 9 crash manager, 12 death pe:flight")
    words = ["exhaust", str(FILE), *(word for case in cases for word in ("--case", case))]
    assert main([*words, "--json"]) == 0
    alone = json.loads(capsys.readouterr().out)
    assert alone == {
        "flights": 3,
        "blows": {"lost": 1, "late-30": 1, "crash": 2, "death": 1},
        "failed": [],
    }
    assert main([*words, "--jobs", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == alone


def test_a_phase_that_is_entered_is_a_story_like_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    case = "phase glide: 2 late-2 everybody, 3 lost pe:flight"
    assert main(["exhaust", "dg_specs/examples/phases.dg.yaml", "--case", case]) == 0
    assert capsys.readouterr().out == "1 stories, 1 flights (1 late-2, 1 lost), 0 failed\n"


def test_an_aircraft_that_does_not_start_has_no_stories(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "raising.dg.yaml"
    file.write_text(
        FILE.read_text().replace("image: pitch_control", 'image: "scenarios.raising:RaisesAfterHalfASecond"')
    )
    assert main(["exhaust", str(file), "--case", "crash pe:flight: 1 lost everybody"]) == 2
    assert "this aircraft does not start" in capsys.readouterr().err


def test_a_failure_is_told_with_the_command_that_replays_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = FILE.read_text()
    file = tmp_path / "raising.dg.yaml"
    file.write_text(
        text.replace("image: pitch_control", 'image: "scenarios.raising:RaisesAfterHalfASecond"')
    )  # and the oracle does not know
    case = "start: 5 doubled everybody"
    how = ["--standby", "--keyed", "--foreseen", "0"]
    assert main(["exhaust", str(file), *how, "--case", case]) == 1
    assert f"{shlex.join(how)} --case" in capsys.readouterr().out
    assert main(["exhaust", str(file), "--case", case]) == 1
    out = capsys.readouterr().out.splitlines()
    assert out[0] == case
    assert "VIOLATION" in out[1]
    replay = next(line for line in out if "replay with: " in line).partition("replay with: ")[2]
    assert shlex.split(replay) == ["heronry", "exhaust", str(file), "--case", case]
    assert main(["exhaust", str(file), "--case", case, "--json"]) == 1
    (failed,) = json.loads(capsys.readouterr().out)["failed"]
    assert (failed["case"], failed["replay"]) == (case, replay)


@pytest.mark.parametrize(
    "faults",
    [
        "999999 lost pe:flight",
        "3 crash pe:tail_b, 999999 crash manager",
        "40 lost pe:tail_a",  # which is dead
        "0 doubled manager",  # which has sent it
    ],
)
def test_a_named_frame_fault_that_is_not_injected_fails(faults: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exhaust", str(FILE), "--case", f"crash pe:tail_a: {faults}"]) == 1
    told = [line for line in capsys.readouterr().out.splitlines() if "VIOLATION" in line]
    assert len(told) == 1
    assert f"missed: '{faults.rsplit(', ', maxsplit=1)[-1]}' was not injected: there was no such frame" in told[0]


def test_a_sample_of_no_flights_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exhaust", str(FILE), "--sample", "0"]) == 2
    assert (
        capsys.readouterr().err == "heronry: --sample 0: there is nothing to fly; write 1 or more, or add --pairs N\n"
    )


def test_silence_without_need_is_seen_in_every_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "resting.dg.yaml"
    rests = '{image: "scenarios.raising:RestsForThreeSeconds", device: elevator_servo_'
    file.write_text(FILE.read_text().replace("{device: elevator_servo_", rests))
    assert main(["exhaust", str(file), "--case", "start: 5 crash manager"]) == 1
    told = capsys.readouterr().out
    assert "service: elevator was silent for" in told
    assert "silence: elevator was not heard, though only managers had failed" in told


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        ("crash pe:tail: 5 lost everybody", "there is no story 'crash pe:tail'"),
        ("start: five lost everybody", "write NUMBER KIND VICTIM"),
        ("start: 5 eaten everybody", "KIND is one of lost, doubled"),
        ("start: 5 lost pe:nobody", "there is no node 'pe:nobody'"),
        ("start: 5 crash everybody", "only a single node can crash; name one of manager, pe:flight"),
    ],
)
def test_a_case_that_makes_no_sense_is_refused(case: str, sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exhaust", str(FILE), "--case", case]) == 2
    assert sentence in capsys.readouterr().err
