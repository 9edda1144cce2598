"""A few faults of the campaign `lab.partition_kills`: all of them end well."""

import pytest

from lab.partition_kills.__main__ import main
from thoroughness import part_of

pytestmark = pytest.mark.live


def test_what_is_injected_is_restarted_given_up_or_planned_around(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--kills", str(part_of(10)), "--rest", "0.1", "--heartbeat-ms", "200"]) == 0
    words = capsys.readouterr().out
    assert "FAILURE" not in words
    assert "PEs lost without an injected fault" in words
