"""For every rule a whole spec with the mistake and its twin without it, a line or two apart: read them side by side.

`twins/DG204.bad.yaml` earns its code, and nothing else, where an arrow says so (`# <- DG204`). Where a comment is
what the rule is about, or cannot be, it is where the twins differ. `twins/DG204.good.yaml` earns nothing at all. (They
do not end in .dg.yaml, or `heronry check` would find them in a checkout.)
"""

from difflib import SequenceMatcher
from pathlib import Path

import pytest

from heronry_dg.check.assess import assess
from heronry_dg.findings import Finding
from heronry_dg.rules import file
from heronry_dg.yaml_source import MOST_BYTES
from heronry_tools.analysis.check.registry import RULES, checks_of
from heronry_tools.cli import main

TWINS = Path(__file__).parent / "twins"
MADE_BELOW = {file.UNREADABLE.code, file.TOO_LARGE.code}  # no file can show them, or none that one would keep


def assessed(data: bytes) -> tuple[Finding, ...]:
    return assess(data, "x.dg.yaml", checks_of(fast=False), RULES).findings


def twins(code: str) -> tuple[bytes, bytes]:
    return (TWINS / f"{code}.bad.yaml").read_bytes(), (TWINS / f"{code}.good.yaml").read_bytes()


def meant(bad: bytes, good: bytes, code: str) -> set[int]:
    """Lines at which the first finding may be."""
    lines = bad.splitlines()
    arrow = {number for number, line in enumerate(lines, 1) if b"<- " + code.encode() in line}
    return arrow or {number + 1 for begin, end in differences(lines, good.splitlines()) for number in range(begin, end)}


def differences(lines: list[bytes], others: list[bytes]) -> list[tuple[int, int]]:
    opcodes = SequenceMatcher(None, lines, others, autojunk=False).get_opcodes()
    return [(begin, end) for kind, begin, end, *_ in opcodes if kind != "equal"]


@pytest.mark.parametrize("code", sorted(RULES.keys() - MADE_BELOW))
def test_one_twin_earns_its_code_where_it_says_and_the_other_nothing(code: str) -> None:
    bad, good = twins(code)
    found = assessed(bad)
    assert {finding.code for finding in found} == {code}
    assert found[0].place.line in meant(bad, good, code)
    assert assessed(good) == ()


@pytest.mark.parametrize("code", sorted(RULES.keys() - MADE_BELOW))
def test_twins_are_told_apart_at_a_glance(code: str) -> None:
    bad, good = (data.splitlines() for data in twins(code))
    assert bad[0].split(b"  # <-")[0] == good[0]
    assert bad[0].startswith(f"# {code} {RULES[code].name}: ".encode())
    arrow = f"  # <- {code}".encode()
    assert sum(end - begin for begin, end in differences([line.replace(arrow, b"") for line in bad], good)) <= 2


def test_no_code_lacks_twins_and_no_twin_its_code() -> None:
    expected = {f"{code}.{which}.yaml" for code in RULES.keys() - MADE_BELOW for which in ("bad", "good")}
    assert {path.name for path in TWINS.iterdir()} == expected


def test_a_file_that_leads_nowhere_and_its_twin_that_leads_to_a_spec(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, target = tmp_path / "x.dg.yaml", tmp_path / "target"
    path.symlink_to(target)
    assert main(["check", str(tmp_path)]) == 1
    assert f"{path}:1:1: DG001 error: " in capsys.readouterr().out
    target.write_bytes(twins("DG006")[1])
    assert main(["check", str(tmp_path)]) == 0


def test_a_file_beyond_the_limit_and_its_twin_at_the_limit() -> None:
    good = twins("DG006")[1].ljust(MOST_BYTES)
    assert assessed(good) == ()
    assert [finding.code for finding in assessed(good + b" ")] == [file.TOO_LARGE.code]


@pytest.mark.parametrize("code", RULES)
def test_every_code_is_explained_and_has_its_place_in_the_documentation(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", code]) == 0
    assert capsys.readouterr().out.startswith(f"{code} ")
    assert f"\n### {code} {RULES[code].name}\n" in Path("docs/rules.md").read_text()
