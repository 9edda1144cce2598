"""The example specs do what the comments at their heads say.

A head holds command lines (`$ heronry plan ...`), and after each what its plan runs: every running module with its PE,
and its mode where it has several; then every function that is wanted and not served. No other module may run.
"""

import json
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft7Validator

from agent.rig import Flight, best_modes
from heronry_agent.module import Context, Inputs, Module, Value
from heronry_dg.check.assess import assess
from heronry_dg.findings import SpecError
from heronry_dg.loader import SUFFIX, load, loads
from heronry_dg.model import Spec
from heronry_dg.rules.rule import Severity
from heronry_tools.aircraft.images import CATALOGUE
from heronry_tools.analysis.check.registry import RULES, checks_of
from heronry_tools.cli import main
from heronry_wire.canaerospace import DataType, Datum, encode_data

FOLDER = Path("dg_specs/examples")
EXAMPLES = sorted(FOLDER.glob(f"*{SUFFIX}"))
MOST_LINES = 64  # one screen
CLAIM = re.compile(r"^#   \$ (heronry plan .*)\n((?:#   .*\n)+?)(?=#   \$|[^#]|#\n)", re.MULTILINE)


def claims() -> Iterator[tuple[str, str]]:
    """Every command line of a head, and the head's claim about it, on one line."""
    for file in EXAMPLES:
        for claim in CLAIM.finditer(file.read_text()):
            yield claim[1], " ".join(line.removeprefix("#").strip() for line in claim[2].splitlines())


def named(name: str) -> Path:
    return FOLDER / f"{name}{SUFFIX}"


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
    found = assess(file.read_bytes(), str(file), checks_of(fast=False), RULES).findings
    assert [finding for finding in found if finding.severity is Severity.ERROR] == []
    assert [finding for finding in found if not finding.code.startswith("DG4")] == []


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.name)
def test_an_editor_finds_the_schema_and_has_nothing_to_mark(file: Path) -> None:
    text = file.read_text()
    (schema,) = re.findall(r"\A# yaml-language-server: \$schema=(.*)\n", text)
    assert Draft7Validator(json.loads((FOLDER / schema).read_text())).is_valid(yaml.safe_load(text))


def flight_of(spec: Spec) -> Flight:
    """Two seconds of an example, everything in its best mode."""
    flight = Flight(spec, best_modes(spec))
    for running in flight.running.values():
        running.module = Narrowed(running.host, running.module, running.mode.gives)
    flight.fly(2)
    return flight


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.name)
def test_an_example_flies_on_the_images_that_are_shipped(file: Path) -> None:
    spec = load(file)
    assert {module.image for module in spec.modules.values()} <= CATALOGUE.keys()
    flight = flight_of(spec)
    for variable, versions in flight.data.items():
        for value, _, _ in versions.values():
            encode_data(1536, Datum(92, DataType[spec.variables[variable].type], 0, 0, value))
    assert flight.reports == []
    spare = {branch for demux in spec.demuxes.values() for branch in demux.branches[1:]}
    beyond = {variable for producer, variable in spec.sources() if producer in spare}
    assert flight.data.keys() == spec.variables.keys() - beyond


def test_the_voter_reports_the_sensor_that_lies() -> None:
    flight = flight_of(load(named("triplex_voting")))
    flight.plant.fail("pressure_sensor_2", "bias", flight.now_ns, offset=200.0)
    flight.fly(3)
    assert flight.reports == ["device:pressure_sensor_2"] * 3


def test_one_program_falls_silent_and_the_loop_goes_on_with_the_other() -> None:
    flight = flight_of(load(named("n_version")))
    both = flight.data["pitch_angle"]
    assert both.keys() == {1, 2}
    assert flight.value("pitch_angle") == both[1][0]
    flight.stop("gyro_attitude")
    flight.fly(1)
    assert flight.value("pitch_angle") == both[2][0]
    assert flight.value("elevator_demand") is not None


def test_without_its_initial_value_a_loop_is_refused() -> None:
    text = named("feedback").read_text()
    with pytest.raises(SpecError, match="DG203"):
        loads(text.replace(", initial: 0", ""), "feedback")
