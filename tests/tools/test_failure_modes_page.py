"""docs/failure_modes.md describes every fault that the simulator knows, and names a scenario for each.

docs/scenarios.md names scenarios for every rule of the protocol that is built.
"""

import re
from collections import Counter
from pathlib import Path

from heronry_tools.sim.faults.fault import KINDS

PAGE = Path("docs/failure_modes.md")
TABLE = re.compile(r"^\| fault \|.*\n\|[- |]+\n((?:\|.*\n)+)", re.MULTILINE)
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for table in TABLE.findall(PAGE.read_text(encoding="utf-8"))
    for line in table.splitlines()
]
VERBS = {"crash": "kill", "manager_crash": "kill", "reboot": "restore"}  # words that only scenarios have
VERBS |= {"order_fail": "fail", "order_clear": "clear", "order_phase": "phase"}


def test_every_fault_of_the_simulator_has_its_row() -> None:
    told = Counter(name for row in ROWS for name in re.findall(r"`(\w+)`", row[0]))
    assert told == dict.fromkeys(KINDS, 1)


def test_every_row_says_all_of_it() -> None:
    assert {len(row) for row in ROWS} == {5}
    assert all(all(row) for row in ROWS)


def test_a_row_is_shown_by_scenarios_that_do_what_it_says() -> None:
    for row in ROWS:
        shown = [(PAGE.parent / link).read_text(encoding="utf-8") for link in re.findall(r"\]\(([^)]+)\)", row[4])]
        done = [re.findall(r"^at \S+ (\w+)", text, re.MULTILINE) for text in shown]
        missing = [
            kind
            for kind in re.findall(r"`(\w+)`", row[0])
            if not any({kind, VERBS.get(kind, kind)}.intersection(faults) for faults in done)
        ]
        assert missing == [], f"no scenario of this row does it: {row[0]}"


def test_every_rule_that_is_built_is_shown_by_a_scenario() -> None:
    page = Path("docs/scenarios.md")
    shown = re.findall(r"^\| (\d+) \| [^|]+ \| (.+) \|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert [int(rule) for rule, _ in shown] == [*range(1, 15)]
    for _, files in shown:
        assert all((page.parent / link).is_file() for link in re.findall(r"\]\(([^)]+)\)", files))
