"""The harness of all benchmarks: text and JSON have the same figures, and a limit sets the exit code."""

import json
from argparse import Namespace

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
