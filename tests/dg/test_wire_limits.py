"""The limits of the wire: each is found before a flight, and no slice is longer than the bound says."""

import re
from pathlib import Path

import pytest

from heronry_dg.check.examples import whole_spec
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.rules.wire import TOO_LONG_A_SLICE, TOO_MANY
from heronry_dg.situation import situation
from heronry_dg.wire_limits import WireLimitError, exceeded, require_wire_limits
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.planner.greedy.planner import Greedy
from heronry_tools.cli import main
from heronry_wire import capacities

SMALL = "cpu: 0, ram: 0, rate_hz: 10"
ROOT = Path(__file__).parents[2]
FILES = [
    *sorted((ROOT / "dg_specs").rglob("*.dg.yaml")),
    *sorted((ROOT / "tests/scenarios").glob("*.dg.yaml")),
]


def spec_of(fragment: str) -> Spec:
    return loads(whole_spec(fragment).decode(), "x.dg.yaml")


def sentences(fragment: str) -> list[str]:
    return [excess.sentence for excess in exceeded(spec_of(fragment))]


def test_the_numbers_are_those_of_the_protocol() -> None:
    assert capacities.MOST_SLICE_BYTES == 1275
    assert (capacities.MOST_DEVICES, capacities.MOST_MODES) == (256, 256)
    assert (capacities.MOST_MODULES, capacities.MOST_MODULES_OF_A_PE) == (4096, 254)
    assert capacities.MOST_RADIOS == 9


def devices(count: int) -> str:
    return "devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n" + "".join(
        f"  d{number}: {{kind: sensor, pe: nav}}\n" for number in range(count - 2)
    )


def modules(count: int) -> str:
    """So many modules, of which half may run on each PE."""
    return "modules:\n" + "".join(f"  m{n}: {{runs_on: [{('nav', 'tail')[n % 2]}], {SMALL}}}\n" for n in range(count))


def checkpoints(count: int) -> str:
    return modules(count).replace(SMALL, f"{SMALL}, checkpoint: {{bytes: 8, hz: 1, max_age_ms: 9000}}")


def modes(count: int) -> str:
    listed = ", ".join(f"m{number}: {{{SMALL}}}" for number in range(count))
    return f"modules:\n  display: {{modes: {{{listed}}}}}\n"


@pytest.mark.parametrize(
    ("made", "most", "words"),
    [
        (devices, 256, "there are 257 devices, but there may be only 256"),
        (modes, 256, "module 'display' has 257 modes, but may have only 256"),
        (modules, 2 * 254, "255 modules may run on pe 'nav', but it can have only 254"),
        (checkpoints, 256, "there are 257 checkpoints, but there may be only 256"),
        (modules, 4096, "there are 4097 modules, but there may be only 4096"),
    ],
    ids=["devices", "modes", "modules of a PE", "checkpoints", "modules"],
)
def test_one_more_than_the_limit_is_found_and_the_limit_is_not(made: object, most: int, words: str) -> None:
    assert callable(made)
    rest = "" if made not in (modules, checkpoints) else "functions: {showing: {output: m0}}\n"
    assert not [one for one in sentences(made(most) + rest) if words[:12] in one and str(most) in one]
    assert [one for one in sentences(made(most + 1) + rest) if one.startswith(words)]


def test_four_hundred_modules_on_one_pe_are_refused_before_the_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = "cpu: 0.001, ram: 10, rate_hz: 10"
    listed = "".join(f"  m{n}: {{device: gps, {small}}}\n" for n in range(440))
    fragment = f"modules:\n{listed}functions: {{showing: {{output: m0}}}}\n"
    file = tmp_path / "many.dg.yaml"
    file.write_bytes(whole_spec(fragment))
    assert main(["table", str(file), "nav"]) != 0
    said = capsys.readouterr().err
    assert "many: 440 modules may run on pe 'nav', but it can have only 254" in said
    assert "slice of pe 'nav' may need" in sentences(fragment)[1]


@pytest.mark.parametrize("rule", [TOO_MANY, TOO_LONG_A_SLICE], ids=lambda rule: rule.code)
def test_the_compiler_of_tables_refuses_what_check_finds(rule: object) -> None:
    assert rule in (TOO_MANY, TOO_LONG_A_SLICE)
    bad, good = (spec_of(one) for one in (rule.bad, rule.good))  # type: ignore[attr-defined]
    with pytest.raises(WireLimitError, match=re.escape("('heronry check' lists all such mistakes)")):
        Compiler(bad).table("nav")
    assert Compiler(good).table("nav").name == "nav"


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_no_slice_is_longer_than_its_bound(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec, compiler = load(file), Compiler(load(file))
    assert compiler.identities.keys() == {pe.node_id for pe in spec.pes.values()}  # while the limit stands
    monkeypatch.setattr("heronry_dg.wire_limits.MOST_SLICE_BYTES", -1)
    bounds = {
        excess.name: int(found[1])
        for excess in exceeded(spec)
        if excess.is_slice and (found := re.search(r"may need (\d+) bytes", excess.sentence))
    }
    assert bounds.keys() == spec.pes.keys()
    for down in ([], *([f"pe:{pe}"] for pe in spec.pes)):
        plan = Greedy(spec).plan(situation(spec, down), None)
        slices = compiler.configuration(plan.configuration).slices
        assert all(len(slices[pe.node_id]) <= bounds[pe.name] for pe in spec.pes.values())


def test_the_shipped_specs_exceed_nothing() -> None:
    for file in FILES:
        require_wire_limits(load(file))
