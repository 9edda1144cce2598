"""The digest of a spec is that of its meaning: how a file is written does not count, and the order of elements does."""

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from heronry_dg.loader import load, loads
from heronry_dg.meaning import with_digest
from heronry_dg.model import Spec
from heronry_dg.shipped import example_specs, shipped_spec_names, shipped_spec_path
from heronry_manager.contingency.file_format import ContingencyFileError, from_bytes, to_bytes
from heronry_manager.core.memory import Memory
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.shell.journal import Journal, JournalError, whole_journal
from heronry_tools.sim.world.planning import plan_ahead

FILES = (*map(shipped_spec_path, shipped_spec_names()), *example_specs(), Path("dg_specs/flights/eav.dg.yaml"))
SECTIONS = ("buses", "pes", "devices", "variables", "gates", "modules", "functions", "phases", "plants")
Tree = Any


def names_of_elements(tree: Tree) -> Iterator[dict[str, Tree]]:
    """Every map whose keys are names of elements: the sections, `modes`, and `gives`."""
    for section in SECTIONS:
        elements = tree.get(section) or {}
        yield elements
        for element in elements.values() if section == "modules" else ():
            yield from (element[key] for key in ("modes", "gives") if key in element)
            yield from (mode["gives"] for mode in element.get("modes", {}).values() if "gives" in mode)


def with_shuffled_keys(rng: random.Random, tree: Tree, elements: list[int]) -> Tree:
    """A copy of a tree with the keys of every map in another order, but for the maps that are `elements` (by id)."""
    if isinstance(tree, list):
        return [with_shuffled_keys(rng, item, elements) for item in tree]
    if not isinstance(tree, dict):
        return tree
    pairs = [(key, with_shuffled_keys(rng, value, elements)) for key, value in tree.items()]
    if id(tree) not in elements:
        rng.shuffle(pairs)
    return dict(pairs)


def written_otherwise(rng: random.Random, text: str) -> str:
    """The same spec: no comment, other key orders, other notations, other failure rates, and new comments."""
    tree = yaml.load(text, yaml.BaseLoader)
    tree = with_shuffled_keys(rng, tree, [id(one) for one in names_of_elements(tree)])
    for section in SECTIONS:
        for element in (tree.get(section) or {}).values():
            if isinstance(element, dict):
                in_other_notation(rng, element)
    lines = yaml.dump(tree, sort_keys=False, width=rng.choice([40, 100]), default_style=None).splitlines()
    return "".join(f"{line}  # {rng.random()}\n{rng.choice(['', chr(10), '# a line' + chr(10)])}" for line in lines)


def in_other_notation(rng: random.Random, element: dict[str, Tree]) -> None:
    for key in ("ram", "flash", "table_bytes"):
        if re.fullmatch(r"\d+KiB", str(element.get(key))):
            element[key] = str(1024 * int(element[key].removesuffix("KiB")))
    for key in ("cpu", "rate_hz", "deadline_ms", "initial", "max_load", "reserve"):
        if re.fullmatch(r"\d+\.\d+", str(element.get(key))):
            element[key] += "0" * rng.randint(0, 3)
    if "rate_per_h" in element:
        element["rate_per_h"] = str(rng.choice(["0.125", "2e-5"]))


def unquoted(text: str) -> str:
    """YAML with plain numbers: `yaml.dump` quotes texts that look like numbers, and a spec needs numbers."""
    return re.sub(r"'([-+.\deE]+|true|false|null)'", r"\1", text)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
@pytest.mark.parametrize("seed", range(3))
def test_a_spec_that_is_written_otherwise_has_the_same_digest_and_the_same_tables(file: Path, seed: int) -> None:
    spec = load(file)
    again = loads(unquoted(written_otherwise(random.Random(seed), file.read_text())), file.name)
    assert again.digest == spec.digest
    assert tables(again) == tables(spec)


def tables(spec: Spec) -> list[str]:
    compiler = Compiler(spec)
    return [compiler.table(pe).to_json() for pe in spec.pes]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_two_elements_exchanged_make_another_digest(file: Path) -> None:
    plain = unquoted(yaml.dump(yaml.load(file.read_text(), yaml.BaseLoader), sort_keys=False))
    digest = loads(plain, file.name).digest
    assert digest == load(file).digest
    count = len([one for one in names_of_elements(yaml.safe_load(plain)) if len(one) > 1])
    for number in range(count):
        tree = yaml.load(plain, yaml.BaseLoader)
        elements = [one for one in names_of_elements(tree) if len(one) > 1][number]
        pairs = list(elements.items())
        pairs[0], pairs[1] = pairs[1], pairs[0]
        elements.clear()
        elements.update(pairs)
        assert loads(unquoted(yaml.dump(tree, sort_keys=False)), file.name).digest != digest, list(elements)[:2]


BASE = """
dg: 1
name: small
buses: {can0: {bitrate: 500000}}
pes: {one: {node_id: 92, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}}
variables: {height: {type: FLOAT, versions: 3, initial: 1, unit: m}, count: {type: LONG, initial: 1}}
modules:
  source: {gives: {height: 1, count: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  sink: {needs: {or: {k: 0, of: [height, count]}}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
phases: {up: , down: {when: {variable: height, below: 5}}}
functions: {landing: {output: sink, criticality: {default: B, up: C}}}
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("1MiB", "1024KiB"),
        ("cpu: 1,", "cpu: 1.00,"),
        ("versions: 3, initial: 1,", "initial: 1.0, versions: 3,"),
        ("[height, count]", "[{var: height@<=3, worth: [3, 2, 1]}, count]"),
        ("{default: B, up: C}", "{up: C, default: B}"),
        ("below: 5", "below: 5, hold_ms: 0, from: [up]"),
        ("cpu: 1,", "cpu: 1, features: [], table_bytes: 4KiB, rate_per_h: 0.5,"),
        ("bitrate: 500000", "bitrate: 500000, max_load: 0.80, kind: wired, rate_per_h: 1e-3"),
        ("name: small", "name: small\nmanager: {bus: can0}\nseparate: []"),
        ("sink: {needs", "sink: {image: sink, restarts: 2, needs"),
    ],
)
def test_another_notation_and_a_default_that_is_written_change_nothing(old: str, new: str) -> None:
    assert old in BASE
    assert loads(BASE.replace(old, new), "x").digest == loads(BASE, "x").digest


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("name: small", "name: smaller"),
        ("initial: 1, unit: m", "initial: 2, unit: m"),
        ("unit: m", "unit: km"),
        ("type: LONG", "type: ULONG"),
        ("[height, count]", "[count, height]"),
        ("[height, count]", "[height@<=2, count]"),
        ("gives: {height: 1, count: 1}", "gives: {count: 1, height: 1}"),
        ("gives: {height: 1,", "gives: {height: 2,"),
        ("{default: B, up: C}", "{default: B, down: C}"),
        ("k: 0", "k: 1"),
        ("cpu: 1,", "cpu: 1.001,"),
        ("cpu: 1,", "cpu: 1, features: [fpu],"),
    ],
)
def test_another_meaning_is_another_digest(old: str, new: str) -> None:
    assert old in BASE
    assert loads(BASE.replace(old, new), "x").digest != loads(BASE, "x").digest


def test_a_named_gate_counts_as_an_element() -> None:
    gates = "gates: {a: {and: [height]}, b: {and: [count]}}\n"
    exchanged = "gates: {b: {and: [count]}, a: {and: [height]}}\n"
    assert loads(BASE + gates, "x").digest != loads(BASE + exchanged, "x").digest
    assert loads(BASE + gates, "x").digest != loads(BASE, "x").digest


def test_what_is_in_front_of_a_demux_counts_once_in_each_branch() -> None:
    """`repeats` of its key is true: the digest tells it although it leaves out the expression of the DEMUX itself."""
    branch = "{needs: out, cpu: 0.1, ram: 1KiB, rate_hz: 10}"
    demux = BASE.replace("phases:", f"  left: {branch}\n  right: {branch}\ngates: {{out: {{demux: DEMAND}}}}\nphases:")
    demands = ["count", "height", "height@1", "{and: [count, height]}", "{and: [height, count]}"]
    specs = [loads(demux.replace("DEMAND", demand), "x") for demand in demands]
    assert len({spec.digest for spec in specs}) == len(demands)
    for spec in specs:
        one = spec.demuxes["out"]
        assert all(spec.modules[branch].modes["only"].needs == one.needs for branch in one.branches)
        forgotten = replace(spec, demuxes={"out": replace(one, needs=specs[0].demuxes["out"].needs)})
        assert with_digest(forgotten).digest == spec.digest


@pytest.mark.parametrize("name", ["x.dg.yaml", "y.dg.yaml"])
def test_a_spec_without_a_name_is_called_after_its_file(name: str) -> None:
    unnamed: Callable[[str], Spec] = lambda file: loads(BASE.replace("name: small\n", ""), file)  # noqa: E731
    assert (unnamed(name).digest == unnamed("x.dg.yaml").digest) == (name == "x.dg.yaml")


def test_contingencies_and_journal_of_a_spec_are_taken_by_one_that_is_written_otherwise(tmp_path: Path) -> None:
    file = shipped_spec_path("elevator_and_chute")
    spec, name = load(file), Path(str(file)).name
    again = loads(unquoted(written_otherwise(random.Random(1), file.read_text())), name)
    other = loads(file.read_text().replace("cpu: 0.20", "cpu: 0.19"), name)
    kept = to_bytes(plan_ahead(spec, 0), spec)
    assert from_bytes(kept, again).configurations == from_bytes(kept, spec).configurations
    with pytest.raises(ContingencyFileError, match="made for another spec"):
        from_bytes(kept, other)
    (tmp_path / "manager-126.journal").write_bytes(whole_journal(spec, Memory(term=7)))
    taken = Journal(tmp_path, 126, again)
    assert taken.memory.term == 7
    taken.close()
    with pytest.raises(JournalError, match="has changed since"):
        Journal(tmp_path, 126, other)
