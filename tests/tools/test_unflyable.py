"""Twenty aircraft that cannot fly: `heronry check` names each of them, with the reason.

Each file of the folder `unflyable` says in its second line which finding it must get, and a part of its sentence or
hint. The files were written before the rules that find them. (They do not end in .dg.yaml, or `heronry check` would
find them in a checkout.)
"""

import re
from pathlib import Path

import pytest

from heronry_dg.check.assess import assess
from heronry_dg.rules.rule import Severity
from heronry_tools.analysis.check.registry import RULES, checks_of

AIRCRAFT = sorted((Path(__file__).parent / "unflyable").glob("*.yaml"))
EXPECTED = re.compile("# expected: (DG[0-9]{3}) (.+)")


@pytest.mark.parametrize("path", AIRCRAFT, ids=lambda path: path.stem)
def test_an_aircraft_that_cannot_fly_is_named_with_its_reason(path: Path) -> None:
    data = path.read_bytes()
    expected = EXPECTED.fullmatch(data.decode().splitlines()[1])
    assert expected is not None
    found = assess(data, "x.dg.yaml", checks_of(fast=False), RULES).findings
    told = [f"{one.sentence} ({one.hint})" for one in found if one.code == expected[1]]
    assert any(expected[2] in sentence for sentence in told), told
    assert found[0].severity is Severity.ERROR or expected[1].startswith("DG6")  # code may be on the PEs alone


def test_there_are_twenty() -> None:
    assert len(AIRCRAFT) == 20


def test_what_can_fly_keeps_its_findings_of_robustness() -> None:
    (servo,) = [path for path in AIRCRAFT if path.stem == "unreachable_pe"]
    found = assess(servo.read_bytes(), "x.dg.yaml", checks_of(fast=False), RULES).findings
    assert [one.code for one in found][:2] == ["DG309", "DG401"]
