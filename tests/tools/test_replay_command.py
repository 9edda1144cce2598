"""`heronry replay`: a recording gives the same decisions again, with their reasons; differences are reported."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.plan import Plan, make_plan
from heronry_manager.core.vocabulary import RequestPlan
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.recording.masterships import masterships, on_the_managers_bus, read_recording
from heronry_tools.runtime.wake_ups import with_heartbeat
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.replay.comparison import compared
from heronry_tools.sim.replay.rerun import Planners, Rerun
from heronry_tools.sim.world import planning
from heronry_wire.authentication import KEY_BYTES
from heronry_wire.frame import LoggedFrame, format_log_line
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from scenarios.flights import KEY, MS, elevator_and_chute, flying, twin_wires

SPEC = "elevator_and_chute"


def recorded(simulation: Simulation, file: Path, *, from_ns: int = 0) -> Path:
    lines = [
        format_log_line(LoggedFrame(sent.end_ns, sent.bus, sent.frame))
        for sent in simulation.trace
        if sent.end_ns >= from_ns
    ]
    file.write_text("\n".join(lines) + "\n")
    return file


def flight_with_a_loss(planners: planning.Planners = planning.Planners.BEST) -> Simulation:
    simulation = flying(elevator_and_chute(), keep_trace=True, planners=planners)
    simulation.fleet.kill("tail_pe")
    simulation.run_for(500 * MS)
    simulation.fleet.restore("tail_pe")
    simulation.run_for(1_000 * MS)
    return simulation


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(flight_with_a_loss(), tmp_path_factory.mktemp("log") / "flight.log")


def replayed(capsys: pytest.CaptureFixture[str], file: Path, *more: str) -> tuple[int, dict[str, Any]]:
    code = main(["replay", str(file), SPEC, "--json", *more])
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return code, document


def test_a_recording_gives_the_same_decisions_with_their_reasons(capsys: pytest.CaptureFixture[str], log: Path) -> None:
    assert main(["replay", str(log), SPEC]) == 0
    told = capsys.readouterr().out
    assert told.startswith("manager 126, term 1: ")
    assert told.endswith("decisions, all as recorded\n\n")
    story = ["the best plan", "PREPARE epoch 1", "pe lost tail_pe: silent for", "without pe:tail_pe", "PREPARE epoch 2"]
    story += ["pe joined tail_pe: back", "PREPARE epoch 3"]
    places = [told.index(part) for part in story]
    assert places == sorted(places)


def test_a_recording_in_which_nothing_is_decided_says_so(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    simulation = Simulation(elevator_and_chute(), keep_trace=True)
    while not simulation.managers.foremost or not simulation.managers.foremost.core.is_active:
        simulation.run_for(MS)
    simulation.run_for(3 * MS)  # LEASE is out, and PREPARE comes later
    file = recorded(simulation, tmp_path / "start.log")
    main(["replay", str(file), SPEC])
    assert capsys.readouterr().out.endswith("the manager decided nothing, so there is nothing to compare\n\n")


def test_what_a_greedy_manager_planned_is_known_for_that(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = recorded(flight_with_a_loss(planning.Planners.GREEDY), tmp_path / "greedy.log")
    code, document = replayed(capsys, file)
    assert (code, document["masterships"][0]["differences"]) == (0, 0)
    (mastership,), page = document["masterships"], Path("docs/operator.md").read_text()
    words = {*document, *mastership, *(key for entry in mastership["entries"] for key in entry)}
    assert sorted(key for key in words if f"`{key}`" not in page) == []


def test_a_second_mastership_is_replayed_by_itself(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    simulation = flying(elevator_and_chute(), keep_trace=True)
    simulation.managers.kill()
    simulation.run_for(300 * MS)
    simulation.managers.start()
    simulation.run_for(1_500 * MS)
    code, document = replayed(capsys, recorded(simulation, tmp_path / "two.log"))
    assert code == 0
    assert [mastership["term"] for mastership in document["masterships"]] == [1, 3]
    second = document["masterships"][1]
    assert second["decisions"] == 0  # it adopted what ran
    assert any("adopted" in entry.get("remark", "") for entry in second["entries"])


def test_a_loss_that_the_recording_does_not_show_is_a_difference(
    capsys: pytest.CaptureFixture[str], log: Path, tmp_path: Path
) -> None:
    """Without the first computer's states and emergencies it is never available in the replay."""
    node = elevator_and_chute().pes["control_pe"].node_id
    silent = [f" {identifier:03X}#" for identifier in (state_id(node), emcy_id(node))]
    lines = [line for line in log.read_text().splitlines() if not any(mark in line for mark in silent)]
    file = tmp_path / "without.log"
    file.write_text("\n".join(lines) + "\n")
    code, document = replayed(capsys, file)
    assert code == 1
    assert {entry["taken"] for entry in document["masterships"][0]["entries"] if "taken" in entry} >= {"recorded"}
    assert main(["replay", str(file), SPEC]) == 1
    assert "NOT REPLAYED" in capsys.readouterr().out


def test_a_computer_that_stood_still_lost_no_pe_for_that(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """As in a demo on a busy computer: its nodes wake together, and the manager takes their frames before it acts."""
    simulation, file = flight_with_a_loss(), tmp_path / "busy.log"
    alive = management_id(126, Command.ALIVE)
    stops_ns = next(sent.end_ns for sent in simulation.trace if sent.end_ns > 400 * MS and sent.frame.can_id == alive)
    late = ((sent.end_ns + 90 * MS * (sent.end_ns > stops_ns), sent) for sent in simulation.trace)
    lines = (format_log_line(LoggedFrame(at_ns, sent.bus, sent.frame)) for at_ns, sent in late)
    file.write_text("\n".join(lines) + "\n")
    code, document = replayed(capsys, file)
    assert code == 0, document
    lost = [entry["remark"] for entry in document["masterships"][0]["entries"] if "pe lost" in entry.get("remark", "")]
    assert len(lost) == 1


@pytest.mark.parametrize(
    ("contingencies", "told"),
    [
        (None, "is no configuration of demux_actuators: give the spec of the recording"),
        (1, "is no contingency of demux_actuators: give the spec and --contingencies of the recording"),
    ],
)
def test_a_recording_of_another_spec_is_told_as_such(
    contingencies: int | None, told: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    simulation = Simulation(elevator_and_chute(), keep_trace=True, contingencies=contingencies)
    simulation.run_for(1_000 * MS)
    file = recorded(simulation, tmp_path / "flight.log")
    assert main(["replay", str(file), "dg_specs/examples/demux_actuators.dg.yaml"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    said = printed.err.splitlines()[-1]  # it may have to plan ahead, which is said first
    assert said.startswith(f"heronry: {file}: epoch 1 (")
    assert said.endswith(told)
    assert main(["replay", str(file), SPEC]) == 0
    assert "DIFFERS" not in capsys.readouterr().out


@pytest.mark.parametrize("heartbeat_ms", [20, 160, 320])
def test_a_flight_with_a_stretched_heartbeat_is_replayed_with_that(
    heartbeat_ms: int, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    simulation = flying(with_heartbeat(elevator_and_chute(), heartbeat_ms * MS), keep_trace=True)
    simulation.fleet.kill("tail_pe")
    simulation.run_for(5_000 * MS)
    file = recorded(simulation, tmp_path / "slow.log")
    code, document = replayed(capsys, file)
    assert (code, document["heartbeat_ns"]) == (0, heartbeat_ms * MS)
    assert document["masterships"][0]["decisions"] >= 4
    assert main(["replay", str(file), SPEC]) == 0
    said = f"flown with a heartbeat of {heartbeat_ms} ms, and not 20 ms as in the spec: the replay does so too\n"
    assert capsys.readouterr().out.startswith(said) == (heartbeat_ms != 20)


# Flights with a key


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    file = tmp_path / "fleet.key"
    file.write_text(f"{bytes(KEY_BYTES).hex()}\n")
    file.chmod(0o600)
    return file


def keyed_flight(*faults: str) -> Simulation:
    spec = elevator_and_chute()
    simulation = flying(spec, key=KEY, keep_trace=True)
    Injections(simulation, tuple(read_fault(spec, fault) for fault in faults), simulation.now_ns)
    simulation.run_for(2_500 * MS)
    return simulation


def test_what_flew_with_a_key_is_replayed_by_what_the_key_proves(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, key_file: Path
) -> None:
    """While an attacker without it forges commands and reports, and repeats true commands; one report is true."""
    simulation = keyed_flight(
        "0 attack bus:can0 for 2", "0.3 raise module:servo_driver_1", "1.03 crash pe:tail_pe for 0.4"
    )
    code, document = replayed(capsys, recorded(simulation, tmp_path / "keyed.log"), "--key", str(key_file))
    assert code == 0
    (mastership,) = document["masterships"]
    remarks = [entry.get("remark", "") for entry in mastership["entries"]]
    assert [remark for remark in remarks if "fault reported" in remark] == [
        "fault reported module:servo_driver_1: tail_pe"
    ]
    assert any("pe lost tail_pe" in remark for remark in remarks)
    assert mastership["decisions"] > 4


def test_the_masterships_of_a_keyed_manager_that_was_restarted_are_replayed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, key_file: Path
) -> None:
    simulation = keyed_flight("0.1 manager_crash manager for 0.3", "1.2 crash pe:tail_pe")
    code, document = replayed(capsys, recorded(simulation, tmp_path / "keyed.log"), "--key", str(key_file))
    assert (code, [mastership["term"] for mastership in document["masterships"]]) == (0, [1, 3])


def test_a_key_is_named_where_there_was_one_and_where_there_was_none_it_is_not(
    capsys: pytest.CaptureFixture[str], log: Path, tmp_path: Path, key_file: Path
) -> None:
    keyed = recorded(keyed_flight(), tmp_path / "keyed.log")
    assert "is of a flight with a key: name the key file with --key" in refused(capsys, str(keyed), SPEC)
    assert "without a key: leave --key out" in refused(capsys, str(log), SPEC, "--key", str(key_file))
    key_file.write_text(f"{'11' * KEY_BYTES}\n")
    told = refused(capsys, str(keyed), SPEC, "--key", str(key_file))
    assert f"the recording has no LEASE that {key_file} proves" in told


class OnlyNothing(Planners):
    """A planner that knows one plan: that nothing runs."""

    def plans(self, request: RequestPlan) -> Iterator[tuple[str, Plan]]:
        nothing = Configuration()
        worth = score(self.spec, request.now, nothing, request.running)
        yield "nothing at all", make_plan(self.spec, request.now, nothing, worth, optimal=False)


def test_a_plan_that_the_replay_would_not_make_is_told_and_flown_on_with(log: Path) -> None:
    spec: Spec = elevator_and_chute()
    frames, _ = read_recording(log)
    (mastership,) = masterships(spec, on_the_managers_bus(spec, frames, None))
    rerun = Rerun(OnlyNothing(spec), mastership)
    rerun.run()
    comparison = compared(mastership, rerun)
    remarks = [remark for remark in rerun.remarks if remark.differs]
    assert len(remarks) == comparison.differences() == 3
    assert all("of another value" in remark.text for remark in remarks)
    assert rerun.decisions == mastership.decisions


def test_repetitions_are_no_decisions_and_lines_that_are_no_frames_are_counted(
    capsys: pytest.CaptureFixture[str], log: Path, tmp_path: Path
) -> None:
    prepare = f" {management_id(126, Command.PREPARE):03X}#"
    lines = []
    for line in log.read_text().splitlines():
        lines += [line, line] if prepare in line else [line]
    file = tmp_path / "twice.log"
    file.write_text("\n".join(["# a comment", *lines]) + "\n")
    code, document = replayed(capsys, file)
    assert (code, document["lines_that_are_no_frames"]) == (0, 1)
    assert main(["replay", str(file), SPEC]) == 0
    assert capsys.readouterr().out.startswith("lines of the recording without a frame: 1\n")


@pytest.mark.parametrize("channel", ["can0", "vcan7"])
def test_the_only_channel_is_the_managers_bus(
    capsys: pytest.CaptureFixture[str], log: Path, tmp_path: Path, channel: str
) -> None:
    file = tmp_path / "named.log"
    file.write_text(log.read_text().replace(f" {elevator_and_chute().manager.bus} ", f" {channel} "))
    assert replayed(capsys, file)[0] == 0


def test_both_channels_of_a_replicated_bus_are_one_bus_and_one_of_them_is_enough() -> None:
    """The second channel carries all, and the first one is cut in the middle."""
    simulation = flying(twin_wires(), keep_trace=True)
    sent = [one for one in simulation.trace if one.bus == "can0"]
    second = [LoggedFrame(one.end_ns, "can8", one.frame) for one in sent]
    first = [one._replace(channel="can7") for one in second[: len(second) // 2]]
    log = sorted([*first, *second], key=lambda one: one.time_ns)
    both = on_the_managers_bus(twin_wires(), log, "can7,can8")
    assert [one.frame for one in both] == [one.frame for one in sent]
    assert on_the_managers_bus(twin_wires(), log, "can8") == second
    with pytest.raises(UserError, match="no frame of the recording is on 'can9'"):
        on_the_managers_bus(twin_wires(), log, "can7,can9")


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["replay", *arguments]) == 2
    return capsys.readouterr().err


def test_what_cannot_be_replayed_is_said_in_a_sentence(
    capsys: pytest.CaptureFixture[str], log: Path, tmp_path: Path
) -> None:
    empty, late, quiet = tmp_path / "empty.log", tmp_path / "late.log", tmp_path / "quiet.log"
    empty.write_text("nothing\n")
    assert "holds no frame" in refused(capsys, str(empty), SPEC)
    lease = f" {management_id(126, Command.LEASE):03X}#"
    lines = log.read_text().splitlines()
    late.write_text("\n".join(lines[len(lines) // 2 :]) + "\n")
    assert "begins in the middle of a mastership" in refused(capsys, str(late), SPEC)
    quiet.write_text("\n".join(line for line in lines if lease not in line) + "\n")
    assert "no manager is active" in refused(capsys, str(quiet), SPEC)
    assert "name the manager's bus with --channel" in refused(capsys, str(log), SPEC, "--channel", "can9")
    assert "No such file" in refused(capsys, str(tmp_path / "none.log"), SPEC)
