"""docs/ agree with the code: tables, states, sub-rules, examples, links."""

import inspect
import pkgutil
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from itertools import pairwise, product
from pathlib import Path
from typing import TypeVar

import pytest
import yaml

from heronry_agent.core.configuration import ActiveConfiguration
from heronry_agent.core.configuration.staging import Configured
from heronry_agent.core.modules.publishing import Publisher
from heronry_agent.core.table_index import TableIndex
from heronry_dg import gates, model, verify
from heronry_dg.keys import key_names
from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import UnknownElementError, situation
from heronry_manager.core.tables import Compiler
from heronry_manager.core.transitions import TransitionTable
from heronry_wire.canaerospace import DataType, Validity
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.layout import Layout
from heronry_wire.management import FaultCode, Step
from heronry_wire.standard_identifiers import standard_identifiers
from heronry_wire.state_frames import PeFlags, PeState, Reason
from lab.documents import event_table
from lab.documents.__main__ import DIAGRAMS, TABLES, filled, main

T = TypeVar("T")

ROOT = Path(__file__).parents[3]
PAGES = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", *sorted((ROOT / "docs").rglob("*.md"))]
SEMANTICS = (ROOT / "docs/semantics.md").read_text(encoding="utf-8")
PROTOCOL = (ROOT / "docs/protocol.md").read_text(encoding="utf-8")
RECONFIGURATION = (ROOT / "docs/protocol/reconfiguration.md").read_text(encoding="utf-8")

named = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def fenced(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def tail() -> TableIndex:
    """Return the table of a PE that has the branches of a DEMUX."""
    spec = load(shipped_spec_path("elevator_and_chute"))
    return TableIndex(Compiler(spec).table("tail_pe"))


def rows(text: str, head: str) -> list[list[str]]:
    """Return the cells of the table whose first heading is `head`."""
    table = re.search(rf"^\| {re.escape(head)} \|.*\n\|[- |]+\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert table, f"no table begins with {head}"
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table[1].splitlines()]


# Tables


@named
def test_the_tables_and_diagrams_of_a_page_are_as_the_code_writes_them(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, f"write them anew: python -m lab.documents {page.relative_to(ROOT)}"


@pytest.mark.parametrize(("kind", "names"), [("table", TABLES), ("diagram", DIAGRAMS)])
def test_every_table_and_diagram_has_its_place_on_a_page(kind: str, names: Iterable[str]) -> None:
    mark = re.compile(rf"^<!-- {kind}: (.+) \(generated: python -m lab\.documents PAGE\) -->$", re.MULTILINE)
    placed = [name for page in PAGES for name in mark.findall(page.read_text(encoding="utf-8"))]
    assert sorted(placed) == sorted(names)


def made_in(package: str, kind: type[T]) -> list[T]:
    """Return the public values of a type that the modules of a package make, each once."""
    names = [found.name for found in pkgutil.walk_packages(import_module(package).__path__, f"{package}.")]
    values = [item for name in names for item in vars(import_module(name)).items()]
    made = {id(value): value for name, value in values if isinstance(value, kind) and not name.startswith("_")}
    return list(made.values())


def test_the_fields_of_every_frame_are_on_the_page() -> None:
    layouts = made_in("heronry_wire", Layout)
    assert {row[0].strip("`") for row in rows(PROTOCOL, "message | bytes")} - {""} == {one.name for one in layouts}


def test_every_state_machine_that_is_a_table_is_drawn() -> None:
    packages = ("heronry_manager.core", "heronry_agent.core", "heronry_wire")
    assert sum(len(made_in(package, TransitionTable)) for package in packages) == len(DIAGRAMS)


def test_an_event_says_its_fields_and_what_it_tells() -> None:
    told = next(line for line in event_table.of_pes().splitlines() if line.startswith("| `pe_lost` |"))
    assert told == (
        "| `pe_lost` | `pe` (text), `cause` (text), `last_heard_ns` (integer or null; null: never heard), `waited` "
        "(`Waited` or null; may be left out; only in a demo that has not killed the PE: which process waited longest "
        "for a processor) | The PE is no longer available |"
    )
    assert event_table.words_of(Mapping[str, tuple[int, bool]]) == "object of [integer, true or false]"


def test_a_table_with_another_content_is_written_anew(tmp_path: Path) -> None:
    page = tmp_path / "protocol.md"
    page.write_text(PROTOCOL.replace("165 + n", "166 + n"), encoding="utf-8")
    main([str(page)])
    assert page.read_text(encoding="utf-8") == PROTOCOL


def test_the_sub_rules_are_those_of_the_verifier() -> None:
    sources = [Path(inspect.getfile(module)).read_text(encoding="utf-8") for module in (verify, gates)]
    named_by_judge = {rule for source in sources for rule in re.findall(r'"(\d\.[a-z_]+)"', source)}
    assert set(re.findall(r"`(\d\.[a-z_]+)`", SEMANTICS)) == named_by_judge


def test_the_reasons_and_fault_codes_are_those_of_the_codec() -> None:
    assert [row[0] for row in rows(PROTOCOL, "reason")] == [reason.name for reason in Reason]
    codes = [row[0] for row in rows(PROTOCOL, "code of an EMCY")]
    assert codes == [f"{code.name} {code.value:04X}" for code in FaultCode]
    assert [Step[row[0]] for row in rows(RECONFIGURATION, "step")] == sorted(set(Step) - {Step.PREPARED})
    assert all(f"{flag.value} {flag.name}" in PROTOCOL for flag in PeFlags)
    validities = ", ".join(f"{validity.value} {validity.name.lower().replace('_', ' ')}" for validity in Validity)
    assert f"Validity is {validities}" in PROTOCOL


def test_the_echoes_have_the_types_that_an_agent_gives_them(tail: TableIndex) -> None:
    publisher = Publisher(tail)
    written = publisher.echo("elevator_servo_1", 1.5)
    assert written is not None
    echoes = [DataType(written.data[1]).name, DataType(publisher.output_echo(0, 0).data[1]).name]
    assert [row[1] for row in rows(PROTOCOL, "it shows")] == echoes


def test_the_identifiers_with_an_index_in_byte_2_are_those_of_the_list() -> None:
    held = sorted(can_id for can_id, entry in standard_identifiers().items() if entry.byte_2_is_an_index)
    spans = re.search(r"standard identifiers \((\d+) to (\d+), (\d+) to (\d+)\)", PROTOCOL)
    assert spans
    first, last, second, end = map(int, spans.groups())
    assert {first, last, second, end} <= set(held)
    assert all(first <= can_id <= last or second <= can_id <= end for can_id in held)


# States


def take_steps(index: TableIndex, wanted: Slice, steps: list[tuple[int, Step]]) -> Iterator[tuple[PeState, PeState]]:
    """Let a PE make the steps of epochs; gives the state before and after each."""
    pe = ActiveConfiguration(index)
    targets = {epoch: Configured(epoch, epoch, wanted if epoch % 2 else Slice(), 1, 0) for epoch, _ in steps}
    for epoch, step in steps:
        before = pe.state
        target = pe.running if pe.running.epoch == epoch else targets[epoch]
        if pe.advance(target, step) is not None:
            pe.validate()
            yield before, pe.state


def test_what_a_pe_does_is_drawn_and_all_that_is_drawn_can_be_done(tail: TableIndex) -> None:
    branch = next(module for module in tail.modules.values() if module.demux)
    wanted = Slice((ModuleSlice(branch.index, 0, (None,)),))
    orders = product((Step.BREAK, Step.GO, Step.GO_ALL), repeat=4)
    sequences = [list(zip((1, 2, 3, 3), order, strict=True)) for order in orders]
    changes = [change for steps in sequences for change in take_steps(tail, wanted, steps)]
    seen = {(before.name, after.name) for before, after in changes if before is not after}
    diagrams = fenced(RECONFIGURATION, "mermaid")
    assert seen in [set(re.findall(r"^ +(\w+) --> (\w+)", text, re.MULTILINE)) for text in diagrams]


# Examples


@pytest.fixture(scope="module")
def example() -> str:
    return fenced(SEMANTICS, "yaml")[0]


def test_the_example_spec_loads_and_has_every_key_there_is(example: str) -> None:
    loads(example, "docs/semantics.md")
    written = yaml.safe_load(example)

    def entries(section: str, kind: type) -> set[tuple[str, str]]:
        return {(section, key) for key in key_names(kind)}

    def used(section: str, elements: Iterator[dict[str, object]]) -> set[tuple[str, str]]:
        return {(section, key) for element in elements for key in element}

    modules = written["modules"].values()
    modes = [mode for module in modules for mode in module.get("modes", {}).values()]
    every, found = entries("", model.Spec), used("", iter([written]))
    for section, kind in (("buses", model.Bus), ("pes", model.Pe), ("devices", model.Device)):
        every |= entries(section, kind)
        found |= used(section, iter(written[section].values()))
    every |= entries("variables", model.Variable) | entries("functions", model.Function)
    found |= used("variables", iter(written["variables"].values()))
    found |= used("functions", iter(written["functions"].values()))
    every |= entries("modules", model.Module) | {("modules", "modes")} | entries("modes", model.Mode)
    found |= used("modules", iter(module for module in modules if "modes" in module)) | used("modes", iter(modes))
    found |= {("modules", key) for module in modules for key in module if key in key_names(model.Module)}
    every |= entries("when", model.When) | entries("contingency", model.Contingency)
    found |= used("when", iter(phase["when"] for phase in written["phases"].values() if "when" in phase))
    found |= used("contingency", iter([written["contingency"]]))
    every |= entries("plants", model.Plant)
    found |= used("plants", iter(written["plants"].values()))
    every |= entries("manager", model.Manager)
    found |= used("manager", iter([written["manager"]]))
    assert found == every


@pytest.mark.parametrize("expression", yaml.safe_load(fenced(SEMANTICS, "yaml")[1]), ids=str)
def test_every_example_of_a_gate_expression_loads(expression: object, example: str) -> None:
    spec = yaml.safe_load(example)
    spec["variables"]["altitude"]["versions"] = 3
    spec["variables"] |= {name: {"type": "FLOAT"} for name in ("speed", "heading")}
    spec["modules"]["display"]["needs"] = expression
    loaded = loads(yaml.safe_dump(spec, sort_keys=False), "docs/semantics.md")
    assert loaded.modules["display"].modes["only"].needs is not None


def test_every_example_of_a_fault_or_a_limit_is_understood(example: str) -> None:
    spec = loads(example, "docs/semantics.md")
    written = [row[0].strip("`") for row in rows(SEMANTICS, "written")]
    limits = [one for one in written if "=" in one]
    found = situation(spec, [one for one in written if one not in limits], limits)
    assert (len(found.down), len(found.limits)) == (6, 2)
    with pytest.raises(UnknownElementError):
        situation(spec, limits=["device:gps=50%"])


# Links


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as Markdown on the web has them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@named
def test_every_link_to_a_heading_finds_it(page: Path) -> None:
    for path, anchor in re.findall(r"\]\(([^)\s:#]*)#([^)\s]+)\)", page.read_text(encoding="utf-8")):
        target = page.parent / path if path else page
        assert anchor in anchors(target), f"{path}#{anchor}: the page has no such heading"


@pytest.mark.parametrize("text", [SEMANTICS, PROTOCOL], ids=["semantics", "protocol"])
def test_the_rules_are_numbered_without_a_gap(text: str) -> None:
    numbers = [int(number) for number in re.findall(r"^(\d+)\. \*\*", text, re.MULTILINE)]
    assert numbers[0] == 1
    assert all(after == before + 1 for before, after in pairwise(numbers))
    assert numbers[-1] == {SEMANTICS: 10, PROTOCOL: 14}[text]
