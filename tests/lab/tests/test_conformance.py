"""Drills: a PE and a manager alone with somebody who plays the rest of the aircraft by the book."""

import pytest

from lab.conformance import pe_speaking
from lab.conformance.__main__ import main
from lab.conformance.conformance_tests import CONFORMANCE_TESTS, conforms
from lab.conformance.pe_under_test import PeUnderTest


@pytest.mark.parametrize("name", CONFORMANCE_TESTS)
def test_a_node_does_everything_by_the_book(name: str) -> None:
    wrong, _ = conforms(name)
    assert wrong is None


def test_a_conformance_tests_is_the_same_each_time_and_says_what_went_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "pe_speaking.it_counts_to_255_and_on"
    assert conforms(name) == conforms(name) != conforms("pe_speaking.it_answers_a_ping_at_once")
    monkeypatch.setattr(pe_speaking, "PeUnderTest", lambda: PeUnderTest(clock_ppm=500_000))
    wrong, _ = conforms(name)
    assert wrong is not None
    assert wrong.startswith("ConformanceError: sequences")


def test_the_command_plays_those_it_is_told_to(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pe_accepting", "who_answers_in_time_stays"]) == 0
    assert capsys.readouterr().out == "8 of 8 conformance tests passed\n"
    with pytest.raises(SystemExit) as ended:
        main(["nothing_is_named_so"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert "no test has such a name; name one of these files, or a test in it: pe_speaking, pe_accepting, " in told
    assert "." not in told.partition("in it:")[2]
