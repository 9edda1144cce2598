"""Conformance tests: a PE and a manager alone, with the rest of the aircraft played by the test."""

import pytest

from lab.conformance import pe_speaking
from lab.conformance.__main__ import main
from lab.conformance.conformance_tests import CONFORMANCE_TESTS, conforms
from lab.conformance.pe_under_test import PeUnderTest


@pytest.mark.parametrize("name", CONFORMANCE_TESTS)
def test_a_node_conforms(name: str) -> None:
    wrong, _ = conforms(name)
    assert wrong is None


def test_a_conformance_test_is_the_same_each_time_and_reports_its_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "pe_speaking.it_counts_to_255_and_on"
    assert conforms(name) == conforms(name) != conforms("pe_speaking.it_answers_a_ping_at_once")
    monkeypatch.setattr(pe_speaking, "PeUnderTest", lambda: PeUnderTest(clock_ppm=500_000))
    wrong, _ = conforms(name)
    assert wrong is not None
    assert wrong.startswith("ConformanceError: sequences")


def test_the_command_plays_the_tests_with_a_given_word(capsys: pytest.CaptureFixture[str]) -> None:
    count = sum("pe_accepting" in name for name in CONFORMANCE_TESTS)
    assert main(["pe_accepting"]) == 0
    assert capsys.readouterr().out.startswith(f"{count} of {count} ")
    with pytest.raises(SystemExit) as ended:
        main(["nothing_is_named_so"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert "pe_speaking, pe_accepting, " in told
    assert not any(name in told for name in CONFORMANCE_TESTS)
