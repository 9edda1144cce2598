"""Every scenario file of this folder holds in the simulator, with the decisions of its golden trace.

After an intended change of a decision run `heronry scenario tests/scenarios/*.scenario --rewrite`, and read the diff.
"""

from pathlib import Path

import pytest

from heronry_tools.sim.scenario.in_simulator import fly
from heronry_tools.sim.scenario.report import text_report
from heronry_tools.sim.scenario.script import read_script
from heronry_tools.sim.scenario.trace import golden_file

FILES = sorted(Path(__file__).parent.glob("*.scenario"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_it_holds(file: Path) -> None:
    flown = fly(read_script(file))
    assert flown.holds, "\n".join(text_report(flown))


def test_there_are_enough_each_with_its_golden_trace_and_each_golden_trace_with_its_scenario() -> None:
    assert len(FILES) >= 30
    assert sorted(Path(__file__).parent.glob("*.golden")) == [golden_file(file) for file in FILES]


def test_each_exists_for_a_reason_of_its_own() -> None:
    reasons = [read_script(file).why for file in FILES]
    assert len(set(reasons)) == len(reasons)
    assert all(len(reason.split()) >= 8 for reason in reasons)
