"""`heronry scenario` as a user sees it: unreadable files, broken expectations, decisions that differ."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from junitparser import JUnitXml

from heronry_manager.core.manager import ManagerCore
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.console.flight_limits import read_share, written_share
from heronry_tools.sim.scenario.evaluation import holds_since
from heronry_tools.sim.scenario.script import read_script
from heronry_tools.sim.scenario.trace import golden_file
from heronry_wire.sansio import InvariantError

DEMUX = Path("dg_specs/examples/demux_actuators.dg.yaml").absolute()
HEAD = f"# A scenario of a test, which exists for that test alone.\nspec {DEMUX}\nseed 3\n"
HOLDS = "at 1s kill pe:tail_a\nexpect function:elevator served by servo_driver_2 within 300ms\nend 2s\n"
FAILS = "at 1s kill pe:tail_a\nexpect function:elevator served within 20ms\nend 2s\n"


def written(tmp_path: Path, body: str, head: str = HEAD) -> Path:
    file = tmp_path / "some.scenario"
    file.write_text(head + body)
    return file


def test_what_holds_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, HOLDS)
    assert main(["scenario", str(file)]) == 0
    assert capsys.readouterr().out == f"{file}: holds (2 s in the simulator, 1 expected)\n"


def test_what_does_not_hold_is_said_with_what_was_seen_and_when(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, FAILS)
    assert main(["scenario", str(file), str(written(tmp_path, FAILS))]) == 1
    head, story, *_, last = capsys.readouterr().out.splitlines()
    assert head == f"{file}: FAILS (2 s in the simulator, 1 expected)"
    assert story.startswith(
        f"  {file}:5: from 1 s on: expected function:elevator served within 20ms; this held from 1.1"
    )
    assert story.endswith("ms after 1.000 s")
    assert last == "2 scenarios, 2 failed"


@pytest.mark.parametrize(
    ("expectation", "holds", "seen"),
    [
        ("function:elevator served throughout", False, "this held from"),
        ("function:elevator served by servo_driver_1 within 0.9s", False, "the last heard was servo_driver_2, at 1.9"),
        ("function:elevator silent within 0.5s", False, "it was heard, last at"),
        ("variable:elevator_demand heard throughout", True, "this held all the time"),
        ("variable:elevator_demand silent within 0s", False, "it was heard, last at"),
        ("variable:horizon_contrast silent within 0s", True, "nothing to the contrary"),  # it stays on one PE
        ("variable:horizon_contrast heard within 0.5s", False, "the last heard was nothing"),
        ("pe:tail_a active within 0.5s", False, "the last heard was active, at 0.9"),
        ("pe:tail_a silent within 0s", True, "nothing to the contrary"),
        ("pe:flight silent within 0s", False, "it was heard, last at"),
        ("pe:tail_b unconfigured throughout", False, "the last heard was active"),
        ("pe:tail_b active within 0.3s", True, "this held from 1."),
        ("pe:tail_b reported within 0.5s", False, "no PE reported that"),
        ("manager heard throughout", True, "this held all the time"),
        ("manager silent within 0.1s", False, "it was heard, last at"),
        ("epoch new within 0.3s", True, "this held from 1."),
        ("epoch unchanged", False, "another epoch was named, last at"),
        ("nothing reported", True, "nothing to the contrary"),
    ],
)
def test_each_expectation_is_evaluated_by_what_was_heard(
    expectation: str, holds: bool, seen: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, f"at 1s kill pe:tail_a\nexpect {expectation}\nend 2s\n")
    assert main(["scenario", str(file), "--json"]) == (0 if holds else 1)
    document = json.loads(capsys.readouterr().out)
    (told,) = document["expectations"]
    page = Path("docs/scenarios.md").read_text()
    assert [key for key in (*document, *told) if f"`{key}`" not in page] == []
    assert (told["expected"], told["holds"], told["line"], told["from_ns"]) == (expectation, holds, 5, 10**9)
    assert seen in told["seen"]


@pytest.mark.parametrize(
    ("deeds", "seen"),
    [
        ("at 1s kill manager\nexpect manager silent within 0s\nexpect manager heard within 0.5s\n", "LEASE, at 0.9"),
        ("at 1s kill manager\nat 1.5s restore manager\nexpect epoch new within 0.4s\n", "the last heard was epoch 1"),
    ],
)
def test_a_manager_s_silence_is_evaluated(
    deeds: str, seen: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenario", str(written(tmp_path, f"{deeds}end 2s\n"))]) == 1
    assert seen in capsys.readouterr().out


def test_a_report_is_heard_and_nothing_reported_then_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = (
        "at 1s raise module:horizon_attitude\nexpect module:horizon_attitude reported within 300ms\n"
        "expect nothing reported\nend 2s\n"
    )
    assert main(["scenario", str(written(tmp_path, body)), "--json"]) == 1
    reported, nothing = json.loads(capsys.readouterr().out)["expectations"]
    assert reported["holds"]
    assert nothing["seen"].startswith("module:horizon_attitude@tail_b was reported, last at 1.")


MINE = """\
from heronry_agent.module import Module

class Mine(Module):
    def step(self, inputs):
        print("a module speaks")
        return {}
"""


def with_own_module(tmp_path: Path) -> Path:
    """A scenario of an aircraft one module of which is the user's own, in the folder of the spec."""
    text = DEMUX.read_text().replace(
        "{device: elevator_servo_1,", '{image: "mine_of_the_user:Mine", device: elevator_servo_1,'
    )
    assert "mine_of_the_user" in text
    (tmp_path / "own.dg.yaml").write_text(text)
    return written(tmp_path, "# One module is the user's own.\nspec own.dg.yaml\nseed 3\nend 1s\n", head="")


def test_a_module_without_code_is_told_before_the_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", str(with_own_module(tmp_path))]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "cannot be simulated (image 'mine_of_the_user:Mine': cannot import mine_of_the_user" in err


def test_what_modules_print_is_no_part_of_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine_of_the_user.py").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    main(["scenario", str(with_own_module(tmp_path)), "--json"])
    out, err = capsys.readouterr()
    json.loads(out)
    assert "a module speaks" in err
    main(["sim", "own.dg.yaml", "--runs", "1", "--seconds", "1", "--jobs", "1", "--json"])
    out, err = capsys.readouterr()
    json.loads(out)
    assert "a module speaks" in err


def test_a_core_that_dies_fails_its_file_and_the_next_one_is_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lives = ManagerCore.validate
    deaths = iter([InvariantError("two epochs at once")])

    def dies_once(core: ManagerCore) -> None:
        for error in deaths:
            raise error
        lives(core)

    file = written(tmp_path, HOLDS)
    golden_file(file).write_text("nothing was decided\n")
    monkeypatch.setattr(ManagerCore, "validate", dies_once)
    assert main(["scenario", str(file), str(written(tmp_path, HOLDS)), "--rewrite"]) == 1
    head, *story, after, last = capsys.readouterr().out.splitlines()
    assert head.startswith(f"{file}: FAILS")
    assert any("violated: " in line and line.endswith("invariant: two epochs at once") for line in story)
    assert (after.split()[1], last) == ("holds", "2 scenarios, 1 failed")
    assert "tail_a is lost" in golden_file(file).read_text()  # of the second flight


def resting(tmp_path: Path) -> Path:
    """A spec whose elevator is not driven for three seconds, which nothing reports."""
    file = tmp_path / "resting.dg.yaml"
    rests = '{image: "scenarios.raising:RestsForThreeSeconds", device: elevator_servo_'
    file.write_text(DEMUX.read_text().replace("{device: elevator_servo_", rests))
    return file


def test_silence_without_need_fails_a_scenario_as_it_fails_a_drawn_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = resting(tmp_path)
    file = written(tmp_path, "at 0.2s manager_pause manager for 5ms\nend 5s\n", head=f"# Why.\nspec {spec}\n")
    assert main(["scenario", str(file)]) == 1
    told = capsys.readouterr().out
    assert "service: elevator was silent for" in told
    assert "silence: elevator was not heard, though only managers had failed" in told
    assert main(["sim", str(spec), "--act", "0.2 manager_pause manager for 0.005", "--seconds", "5"]) == 1
    told = capsys.readouterr().out
    assert "service: elevator was silent for" in told
    assert "silence: elevator was not heard, though only managers had failed" in told


@pytest.mark.parametrize(
    ("deed", "rules"),
    [
        ("kill pe:tail_b", ["service"]),
        ("kill pe:flight", []),  # no plan serves it then
        ("stick device:elevator_servo_2", []),  # which the monitors have to notice
        ("kill manager", ["silence"]),  # no plan can be made
        ("kill manager\nat 0.3s restore manager", ["service", "silence"]),
    ],
)
def test_silence_is_verified_by_what_was_done(
    deed: str, rules: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, f"at 0.2s {deed}\nend 5s\n", head=f"# Why.\nspec {resting(tmp_path)}\n")
    main(["scenario", str(file), "--json"])
    told = json.loads(capsys.readouterr().out)["violations"]
    assert [violation.split()[2] for violation in told] == [f"{rule}:" for rule in rules]


def test_decisions_are_kept_and_another_decision_is_a_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, HOLDS)
    assert main(["scenario", str(file), "--rewrite"]) == 0
    kept = golden_file(file).read_text()
    assert "--- at 1s kill pe:tail_a\ntail_a is lost: silent for 3 heartbeat periods\n" in kept
    assert main(["scenario", str(file)]) == 0
    golden_file(file).write_text(kept.replace("tail_a is lost", "tail_b is lost"))
    capsys.readouterr()
    assert main(["scenario", str(file)]) == 1
    out = capsys.readouterr().out
    assert "    -tail_b is lost: silent for 3 heartbeat periods\n    +tail_a is lost" in out
    assert "--rewrite" in out
    assert main(["scenario", str(file), "--rewrite"]) == 0
    assert golden_file(file).read_text() == kept


def test_of_a_flight_that_fails_no_trace_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, FAILS)
    assert main(["scenario", str(file), "--rewrite"]) == 1
    assert capsys.readouterr().err == f"heronry: {golden_file(file)} is left as it was, since the flight fails\n"
    assert not golden_file(file).exists()


def test_a_golden_trace_that_is_no_text_is_refused_before_anything_flies_and_can_be_made_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, HOLDS)
    golden_file(file).write_bytes(b"\xff\xfe")
    assert main(["scenario", "tests/scenarios/a_processor_dies.scenario", str(file)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.endswith(f"{golden_file(file)}: the file is not text in UTF-8; --rewrite replaces it\n")
    assert main(["scenario", str(file), "--rewrite"]) == 0
    assert "tail_a is lost" in golden_file(file).read_text()


def test_where_no_junit_can_be_written_that_is_said_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, FAILS)
    assert main(["scenario", str(file), "--format", "junit", "-o", str(tmp_path / "none" / "results.xml")]) == 2
    told = capsys.readouterr()
    assert (told.out, "make this folder first" in told.err) == ("", True)
    assert main(["scenario", str(file), "--format", "junit", "-o", str(tmp_path)]) == 2
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", f"heronry: {tmp_path} is a folder; name another file\n")


def test_junit_has_a_case_for_each_expectation_and_for_all_that_is_verified_besides(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results, file = tmp_path / "results.xml", written(tmp_path, FAILS)
    assert main(["scenario", str(file), "--format", "junit", "-o", str(results)]) == 1
    (suite,) = JUnitXml.fromfile(str(results))
    assert (suite.tests, suite.failures) == (2, 1)
    assert [case.name for case in suite] == ["5: function:elevator served within 20ms", "what must never be"]
    golden_file(file).write_text("nothing was decided\n")
    assert main(["scenario", str(file), "--format", "junit", "-o", str(results)]) == 1
    (suite,) = JUnitXml.fromfile(str(results))
    assert (suite.tests, suite.failures) == (3, 2)
    assert [case.name for case in suite][-1] == "decided as before"


def test_a_fault_that_is_not_injected_as_it_is_written_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = "at 1s pause pe:tail_a for 10ms in preparing\nexpect epoch unchanged\nend 6s\n"
    assert main(["scenario", str(written(tmp_path, body))]) == 1
    assert "was not injected as given (injected: pause in idle); try another seed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("body", "line", "sentence"),
    [
        ("at soon kill pe:tail_a", 4, "'soon' is not a time; write it as 2.5s or 80ms"),
        ("at 1s ignite pe:tail_a", 4, "'ignite pe:tail_a' cannot be done; what can be done is kill"),
        ("at 1s kil pe:tail_a", 4, "did you mean 'kill'?"),
        ("at 1s kill pe:tail", 4, "did you mean 'tail_b'?"),
        ("at 1s kill tail_a", 4, "'tail_a' is not a PE; write pe:NAME"),
        ("at 1s restore pe:tail_a", 4, "pe:tail_a runs at that time; kill and restore in turn"),
        ("at 1s kill pe:flight\nat 2s kill pe:flight", 5, "pe:flight does not run at that time"),
        ("without pe:tail_a\nat 1s kill pe:tail_a", 5, "pe:tail_a does not run at that time"),
        ("at 1s restore manager", 4, "manager runs at that time"),
        ("at 1s kill standby", 4, "'kill standby': the flight has only one manager; write 'manager', or a"),
        ("at 1s kill manager\nat 2s restore primary", 5, "the flight has only one manager"),
        ("at 1s manager_crash standby for 1s", 4, "the flight has only one manager"),
        ("at 1s phase landing", 4, "no phase is named 'landing'"),
        ("at 1s fail device:gps", 4, "no device is named 'gps'"),
        ("at 1s pause bus:can0", 4, "pause cannot be injected into bus:can0"),
        ("at 90000s kill pe:tail_a", 4, "'90000s' is longer than a flight may be; write 86400s or less"),
        ("at 1s pause pe:tail_a for 100000s", 4, "'100000s' is longer than a flight may be"),
        ("at 1s pause pe:tail_a for ever", 4, "'ever' is not a time"),
        ("at 2s kill pe:tail_a\nat 1s kill pe:tail_b", 5, "1s is before 2s; write lines in order of time"),
        ("at 2s kill pe:tail_a\nend 1s", 5, "1s is before 2s"),
        ("expect function:rudder served within 1s", 4, "no function is named 'rudder'"),
        ("expect function:elevator served by horizon_driver within 1s", 4, "horizon_driver is no output of elevator"),
        ("expect variable:elevator_deman heard within 1s", 4, "did you mean 'elevator_demand'?"),
        ("expect function:elevator silent by servo_driver_1 within 1s", 4, "only a function is served by a module"),
        ("expect pe:tail_a happy within 1s", 4, "write for example 'expect pe:NAME active within 1s'"),
        ("expect pe:tail_c active within 1s", 4, "no PE is named 'tail_c'"),
        ("expect manager soon", 4, "write for example 'expect manager heard within 1s'"),
        ("expect bus:can0 reported throughout", 4, "cannot be read; write for example"),
        ("expect device:gps reported within 1s", 4, "no device is named 'gps'"),
        (
            "expect epoch new within 2s\nend 1s",
            4,
            "comes before the time of this expectation is over; move it to a later time",
        ),
        (
            "at 1s kill pe:tail_a\nexpect epoch new within 1s\nat 1.5s kill pe:tail_b\nend 9s",
            5,
            "the next 'at' or 'end', at 1.5s",
        ),
        ("expect epoch unchanged\nend 1s\nat 2s kill pe:tail_a", 6, "no line may follow 'end'"),
        ("expect epoch unchanged", 4, "the file does not say when the flight ends"),
        ("loss 0.7", 4, "'loss SHARE'"),
        ("spec big_blue", 4, "a scenario has one spec"),
        ("at 1s kill pe:tail_a\nwithout pe:tail_b", 5, "'without pe:NAME' (before anything is done)"),
        ("seed x", 4, "cannot be read"),
        ("expect", 4, "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_said_with_its_line_and_remedy(
    body: str, line: int, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, f"{body}\n")
    assert main(["scenario", str(file)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"heronry: {file}:{line}: ")
    assert sentence in told


def test_a_semicolon_separates_what_else_stands_on_lines_of_its_own(tmp_path: Path) -> None:
    body = (
        "seed 4; at 1s kill pe:tail_a; expect epoch new within 150ms; # and\nexpect manager heard throughout; end 2s\n"
    )
    script = read_script(written(tmp_path, body))
    assert [(deed.line, deed.text) for deed in script.deeds] == [(4, "kill pe:tail_a")]
    assert [(one.line, one.text) for one in script.expectations] == [
        (4, "epoch new within 150ms"),
        (5, "manager heard throughout"),
    ]
    with pytest.raises(UserError, match=r"some.scenario:4: 'soon' is not a time"):
        read_script(written(tmp_path, "at 1s kill pe:tail_a; at soon restore pe:tail_a\nend 2s\n"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("spec big_blue\nexpect epoch unchanged\nend 1s\n", "the file does not say why it exists"),
        ("#\nspec big_blue\nexpect epoch unchanged\nend 1s\n", "the file does not say why it exists"),
        ("# Why.\nseed 1\n", "the first line must name the spec"),
        ("# Why.\n", "the file names no spec"),
        ("", "some.scenario:1: the file does not say why it exists"),
        ("# Why.\nspec big_blu\n", "neither a file nor a shipped spec"),
    ],
)
def test_a_scenario_begins_with_its_reason_and_its_spec(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=sentence):
        read_script(written(tmp_path, "", head=text))


@pytest.mark.parametrize("share", [0.5, 0.1234567, 1e-05, 0.0])
def test_whatever_loss_a_flight_takes_a_scenario_file_takes_too(share: float, tmp_path: Path) -> None:
    file = written(tmp_path, f"loss {written_share(share)}\nend 1s\n")
    assert read_script(file).loss == share


@given(st.floats(0, 0.5))
def test_a_share_is_written_in_decimals_and_read_again_to_the_bit(share: float) -> None:
    assert set(written_share(share)) <= set("0123456789.-")
    assert read_share(written_share(share)) == share


def test_what_is_no_text_or_not_there_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bytes.scenario"
    file.write_bytes(b"\xff\xfe")
    assert main(["scenario", str(file)]) == 2
    assert "not text in UTF-8" in capsys.readouterr().err
    assert main(["scenario", str(tmp_path / "none.scenario")]) == 2
    assert "No such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("deeds", "sentence"),
    [
        ("at 1s kill manager\nat 2s fail pe:tail_a\n", "no manager is active at that time to accept the order"),
        ("at 1s fail channel:can0.1\n", "no channel is named"),
    ],
)
def test_an_order_that_no_manager_can_accept_is_refused(
    deeds: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenario", str(written(tmp_path, f"{deeds}expect epoch unchanged\nend 3s\n"))]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-i", "softbus", "--rewrite"], "only in the simulator are decisions the same each time"),
        (["-i", "softbus"], "4: 'mute pe:tail_a for 10ms' can be done only in the simulator"),
    ],
)
def test_real_processes_do_not_do_everything(
    words: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, "at 1s mute pe:tail_a for 10ms\nexpect epoch unchanged\nend 2s\n")
    assert main(["scenario", str(file), *words]) == 2
    assert sentence in capsys.readouterr().err


def test_a_channel_is_pulled_from_software_buses_of_its_own_alone(capsys: pytest.CaptureFixture[str]) -> None:
    file = "tests/scenarios/a_channel_is_lost_and_then_the_other.scenario"
    assert main(["scenario", file, "-i", "socketcan", "-c", "no_can0,no_can1"]) == 2
    assert ":3: 'channel_loss channel:can0.1 for 2s' can be done only on software buses that the flight starts" in (
        capsys.readouterr().err
    )


def test_the_simulator_needs_no_patience(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", str(written(tmp_path, HOLDS)), "--patience", "5"]) == 2
    assert "--patience is only for real processes; add -i and -c" in capsys.readouterr().err


@pytest.mark.parametrize("times", ["0.5", "101", "nan", "much"])
def test_a_patience_is_a_number_of_times(times: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["scenario", "some.scenario", "-i", "softbus", "--patience", times])
    sentence = f"the times after 'within' cannot be multiplied by {times}; write a number from 1 to 100"
    assert sentence in capsys.readouterr().err


def test_an_interface_needs_a_channel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", str(written(tmp_path, HOLDS)), "-i", "virtual"]) == 2
    assert "-i virtual needs a channel" in capsys.readouterr().err


@given(st.lists(st.tuples(st.integers(0, 100), st.booleans()), max_size=12).map(sorted), st.integers(1, 20))
def test_something_holds_since_the_first_of_an_unbroken_chain(marks: list[tuple[int, bool]], patience_ns: int) -> None:
    until_ns = 100
    since_ns = holds_since(marks, patience_ns, until_ns)
    if since_ns is None:
        quiet = not any(says and until_ns - t <= patience_ns for t, says in marks)
        assert quiet or not marks[-1][1]
        return
    times = [t for t, says in marks if t >= since_ns]
    assert all(later - t <= patience_ns for t, later in zip(times, [*times[1:], until_ns], strict=True))
    assert all(says for t, says in marks if t > since_ns)


def test_the_example_of_the_page_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = Path("docs/scenarios.md").read_text().split("```\n")[1]
    assert main(["scenario", str(written(tmp_path, example, head=""))]) == 0
    assert "holds" in capsys.readouterr().out


def test_the_results_as_junit_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results, file = tmp_path / "results.xml", written(tmp_path, FAILS)
    assert main(["scenario", str(file), "-o", str(results)]) == 1
    assert capsys.readouterr().out == ""
    (suite,) = JUnitXml.fromfile(str(results))
    assert (suite.tests, suite.failures) == (2, 1)
    assert main(["scenario", str(file), "--format", "junit"]) == 1
    assert capsys.readouterr().out == results.read_text()
