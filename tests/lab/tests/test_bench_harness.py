"""The harness of all benchmarks: text and JSON have the same figures, and a limit sets the exit code."""

import json
from argparse import Namespace
from pathlib import Path

import pytest

from heronry_tools.console.errors import UserError
from lab.benches.harness import Benchmark, Report, counted, option


def measure(arguments: Namespace, report: Report) -> None:
    """Report a figure, and times from 1 on."""
    if arguments.count < 0:
        raise UserError("nothing to measure")
    report.begin("all of them")
    report.figures("{load:.0%} of the bus", load=0.5)
    report.lines(["a detail"])
    report.times("steps", counted("steps", arguments.count, [float(n + 1) for n in range(arguments.count)]), limit=99.0)
    report.times("none", [])


bench = Benchmark("some", "A benchmark.", measure, option("--count", 100, "how many"))


def test_text_has_the_machine_the_figures_and_one_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(["--count", "4"]) == 0
    machine, section, figure, particular, head, row = capsys.readouterr().out.splitlines()
    assert machine.startswith("some: ")
    assert (section, figure, particular) == ("all of them", "50% of the bus", "a detail")
    assert head.split() == ["ms", "count", "median", "p99", "p99.9", "longest", "limit"]
    assert row.split() == ["steps", "4", "2.500", "4.000", "4.000", "4.000", "99.0"]


def test_json_has_the_same_figures_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(["--json", "--count", "100"]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    document = json.loads(line)
    assert document["as_required"] is False
    (section,) = document["sections"]
    assert section["figures"] == {"load": 0.5}
    assert section["times"] == {
        "steps": {"unit": "ms", "count": 100, "median": 50.5, "p99": 100, "p99.9": 100, "longest": 100, "limit": 99}
    }


def test_an_unusable_argument_gives_one_message_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(["--count", "-1"]) == 2
    assert capsys.readouterr().err == "some: nothing to measure\n"


def test_figures_are_kept_and_a_later_run_with_the_same_options_is_compared_with_the_last_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "figures.jsonl"
    for count in ("4", "6"):
        assert bench(["--count", count, "--keep", str(file)]) == 0
    first, second = map(json.loads, file.read_text().splitlines())
    assert (first["words"], second["words"]) == (["--count", "4"], ["--count", "6"])
    assert first["commit"]
    capsys.readouterr()
    assert bench(["--against", str(file), "--count", "4"]) == 0
    *_, title, load, median, p99 = capsys.readouterr().out.splitlines()
    assert title == f"against {first['commit']} (now {first['commit']}):"
    assert load.split() == ["all", "of", "them:", "load", "0.500", "0.500", "1.000"]
    assert median.split()[-3:] == ["2.500", "2.500", "1.000"]
    assert p99.split()[-3:] == ["4.000", "4.000", "1.000"]


def test_figures_of_another_machine_are_called_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "figures.jsonl"
    bench(["--count", "4", "--keep", str(file)])
    file.write_text(json.dumps({**json.loads(file.read_text()), "cores": 99}) + "\n\n[1]\n")
    bench(["--count", "4", "--against", str(file)])
    assert "  on another machine: machine " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "No such file"),
        ("", "has no run of some with --count 4; keep one first with --keep"),
        ("{", "a line is not JSON"),
    ],
)
def test_without_a_run_to_compare_with_nothing_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str | None, says: str
) -> None:
    file = tmp_path / "figures.jsonl"
    if content is not None:
        file.write_text(content)
    assert bench(["--count", "4", "--against", str(file)]) == 2
    assert says in capsys.readouterr().err


def test_a_folder_keeps_no_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(["--count", "4", "--keep", str(tmp_path)]) == 2
    assert "name a file that can be written with --keep" in capsys.readouterr().err
