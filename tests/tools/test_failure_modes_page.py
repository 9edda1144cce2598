"""docs/failure_modes.md speaks of every fault that the simulator knows, and shows each by something that exists."""

import re
from collections import Counter
from pathlib import Path

from heronry_tools.simulator.act import KINDS

PAGE = Path("docs/failure_modes.md")
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| fault", "| ---"))
]


def test_every_fault_of_the_simulator_has_its_row() -> None:
    told = Counter(name for row in ROWS for name in re.findall(r"`(\w+)`", row[0]))
    assert told == dict.fromkeys(KINDS, 1)


def test_every_row_says_all_of_it() -> None:
    assert {len(row) for row in ROWS} == {5}
    assert all(all(row) for row in ROWS)


def test_a_fault_that_is_shown_by_a_kind_is_of_that_kind() -> None:
    for row in ROWS:
        for kind in re.findall(r"--kind (\w+)", row[4]):
            assert f"`{kind}`" in row[0]
