"""The specs to learn from keep what the comments at their heads promise.

A head holds command lines (`$ heronry plan ...`), and after each what its plan runs: every running module with its PE,
and its mode where it has several; then every function that is wanted and not served. Nothing else may run.
"""

import json
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import pytest

from agent.rig import Flight, best_modes
from heronry_agent.images import CATALOGUE
from heronry_agent.module import Context, Inputs, Module, Value
from heronry_dg.check.judge import judge
from heronry_dg.loader import SUFFIX, load
from heronry_dg.model import Spec
from heronry_dg.rules.rule import Severity
from heronry_tools.check.registry import RULES, checks_of
from heronry_tools.cli import main
from heronry_wire.canaerospace import DataType, Datum, encode_data

FOLDER = Path("dg_specs/examples")
EXAMPLES = sorted(FOLDER.glob(f"*{SUFFIX}"))
MOST_LINES = 55  # one screen
CLAIM = re.compile(r"^#   \$ (heronry plan .*)\n((?:#   .*\n)+?)(?=#   \$|[^#]|#\n)", re.MULTILINE)


def claims() -> Iterator[tuple[str, str]]:
    """Every command line of a head, and what the head says of it, on one line."""
    for file in EXAMPLES:
        for claim in CLAIM.finditer(file.read_text()):
            yield claim[1], " ".join(line.removeprefix("#").strip() for line in claim[2].splitlines())


def as_claimed(spec: Spec, document: dict[str, dict[str, dict[str, str]]]) -> str:
    """A plan in the words of a head."""
    runs = [
        f"{name} ({running['mode']}) on {running['pe']}"
        if len(spec.modules[name].modes) > 1
        else f"{name} on {running['pe']}"
        for name, running in document["modules"].items()
    ]
    lost = [
        name
        for name, report in document["functions"].items()
        if not report["served"] and "is not wanted" not in report["why_not"]
    ]
    said = f"runs: {', '.join(runs) or 'nothing'}"
    return said + (f"; not served: {', '.join(lost)}" if lost else "")


class Narrowed(Module):
    """An image of which an example wants only some outputs: as on a PE, the others go nowhere."""

    def __init__(self, ctx: Context, image: Module, wanted: Iterable[str]) -> None:
        super().__init__(ctx)
        self._image = image
        self._wanted = frozenset(wanted)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        outputs = self._image.step(inputs)
        return {variable: value for variable, value in outputs.items() if variable in self._wanted}


@pytest.mark.parametrize(("command", "claim"), [*claims()])
def test_a_plan_is_what_the_head_says(command: str, claim: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = shlex.split(command)
    assert main([*words[1:], "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["optimal"]
    assert as_claimed(load(words[2]), document) == claim


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.name)
def test_a_head_speaks_of_its_own_file_and_of_a_fault(file: Path) -> None:
    text = file.read_text()
    commands = [shlex.split(claim[1]) for claim in CLAIM.finditer(text)]
    assert {words[2] for words in commands} == {str(file)}
    assert len(commands) == text.count("$ heronry")
    assert any(len(words) > 3 for words in commands)
    assert text.count("\n") <= MOST_LINES
    assert load(file).name + SUFFIX == file.name


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.name)
def test_no_rule_finds_an_error_and_none_of_the_fast_ones_has_a_doubt(file: Path) -> None:
    found = judge(file.read_bytes(), str(file), checks_of(fast=False), RULES).findings
    assert [finding for finding in found if finding.severity is Severity.ERROR] == []
    assert [finding for finding in found if not finding.code.startswith("DG4")] == []


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.name)
def test_an_example_flies_on_the_images_that_are_shipped(file: Path) -> None:
    spec = load(file)
    assert {module.image for module in spec.modules.values()} <= CATALOGUE.keys()
    flight = Flight(spec, best_modes(spec))
    for name, running in flight.running.items():
        running.module = Narrowed(running.host, running.module, spec.modules[name].modes[running.host.mode].gives)
    flight.fly(2)
    for variable, versions in flight.data.items():
        for value, _, _ in versions.values():
            encode_data(1536, Datum(92, DataType[spec.variables[variable].type], 0, 0, value))
    assert flight.reports == []
    assert flight.data.keys() == spec.variables.keys()
