"""Fault trees in the Open-PSA format: written and read back, refused with a reason; and scram."""

from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_tools.analysis.reliability.chances import CommonCause, Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import failure
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.open_psa.reading import read_tree
from heronry_tools.analysis.reliability.open_psa.writing import fault_tree
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from lab.fault_tree_race import SCRAM, agree, by_scram, here, races
from thoroughness import part_of

BIG_BLUE = load(shipped_spec_path("big_blue")).in_phase(None)
needs_scram = pytest.mark.skipif(SCRAM is None, reason="there is no scram here; apt-get install scram")

TREE = """<?xml version="1.0"?>
<opsa-mef>
  <define-fault-tree name="pumps">
    <define-gate name="top">
      <or><gate name="both"/><event name="valve"/><house-event name="maintained"/></or></define-gate>
    <define-component name="pair">
      <define-gate name="both"><label>both</label>
        <atleast min="2"><basic-event name="pump-1"/><basic-event name="pump-2"/><and><basic-event name="tank"/>
          <basic-event name="valve"/></and></atleast></define-gate>
      <define-house-event name="maintained"><constant value="false"/></define-house-event>
    </define-component>
  </define-fault-tree>
  <model-data>
    <define-basic-event name="pump-1"><exponential><parameter name="rate"/><system-mission-time/></exponential>
    </define-basic-event>
    <define-basic-event name="pump-2"><exponential><float value="1e-3"/><float value="5"/></exponential>
    </define-basic-event>
    <define-basic-event name="valve"><float value="0.01"/></define-basic-event>
    <define-basic-event name="tank"><Weibull/></define-basic-event>
    <define-parameter name="rate"><float value="2e-3"/></define-parameter>
    <define-CCF-group name="pumps" model="beta-factor"><members><basic-event name="pump-1"/><basic-event name="pump-2"/>
    </members><factors><factor level="2"><float value="0.1"/></factor></factors></define-CCF-group>
  </model-data>
</opsa-mef>
"""


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "tree.xml"
    file.write_text(text)
    return file


def test_a_tree_is_read(tmp_path: Path) -> None:
    tree = read_tree(written(tmp_path, TREE))
    assert tree.tops == ("top",)
    solution = Solution(tree.formula, tree.gates["top"])
    assert set(solution.sets(9)) == {frozenset({"valve"}), frozenset({"pump-1", "pump-2"})}
    assert (tree.rates, tree.demands, tree.without) == ({"pump-1": 2e-3, "pump-2": 1e-3}, {"valve": 0.01}, ("tank",))
    assert tree.common == ((("pump-1", "pump-2"), 0.1),)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("<opsa-mef>", "<opsa", "this is no XML"),
        ("opsa-mef>", "model>", "the root is <model>"),
        ("<opsa-mef>", "<!DOCTYPE x><opsa-mef>", "a document type is not read"),
        (
            "<or>",
            "<or><not><event name='valve'/></not>",
            "gate top has a <not>; only 'or', 'and' and 'atleast' are read",
        ),
        ('min="2"', 'min="9"', "gate both: 'min' is 9; write a number from 0 to 3"),
        ('<basic-event name="tank"/>', '<gate name="top"/>', "depends on itself"),
        ('<basic-event name="tank"/>', '<gate name="lost"/>', "gate both reads gate 'lost', which is not defined"),
        ('name="both"><label>', 'name="top"><label>', "<define-gate> top is defined twice"),
        ('value="0.01"', 'value="1.5"', "basic event valve has the value 1.5; a probability is from 0 to 1"),
        ('value="0.01"', 'value="x"', "'x' is no number"),
        ("beta-factor", "MGL", "common cause group pumps is no beta factor"),
        ("<label>both</label>", "<event name='valve'/>", "gate both has 2 formulas"),
        ("<or>", "<magic>", "this is no XML"),
        ("<define-gate name=", "<define-gate nom=", "a <define-gate> has no name"),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in TREE
    with pytest.raises(UserError, match=r"tree\.xml: ") as refused:
        read_tree(written(tmp_path, TREE.replace(old, new)))
    assert sentence in str(refused.value)


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "openpsa", "nowhere.xml"]) == 2
    assert "nowhere.xml: No such file or directory; name an Open-PSA file" in capsys.readouterr().err


def test_an_imported_tree_is_a_spec_with_the_same_sets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "openpsa", str(written(tmp_path, TREE))]) == 0
    out, err = capsys.readouterr()
    assert "no rate and no probability is read of 1 events: tank" in err
    file = tmp_path / "pumps.dg.yaml"
    file.write_text(out)
    spec = load(file)
    assert list(spec.functions) == ["top"]
    assert set(spec.devices) == {"pump_1", "pump_2", "valve", "tank"}
    found = failure(spec, "top", [f"device:{name}" for name in spec.devices])
    assert set(Solution(found.formula, found.root).sets(9)) == {
        frozenset({"device:valve"}),
        frozenset({"device:pump_1", "device:pump_2"}),
    }
    assert main(["cutsets", str(file), "top", "--kinds", "device", "--order", "2", "--jobs", "1"]) == 0
    assert "resource-aware: the same sets" in capsys.readouterr().out


@pytest.mark.parametrize("function", BIG_BLUE.functions)
def test_what_is_written_is_read_back(tmp_path: Path, function: str) -> None:
    names = elements(BIG_BLUE)
    rates = {name: 1e-3 * number for number, name in enumerate(names, 1)}
    pair = ("pe:tail_a", "pe:tail_b")
    found = Reliability(BIG_BLUE, function, names, Hazards(rates, {}, (CommonCause(pair, 0.2),)))
    text = fault_tree(function, found.failure.formula, found.failure.root, found.hazards, 2.0)
    tree = read_tree(written(tmp_path, text))
    solution = Solution(tree.formula, tree.gates[tree.tops[0]])
    chances = Hazards(tree.rates, tree.demands).chances(2.0)
    assert solution.probability(chances) == pytest.approx(found.loss(2.0), rel=1e-12)


def test_the_command_writes_a_tree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "elevator.xml"
    assert main(["export", "openpsa", "big_blue", "elevator", "--kinds", "pe,device", "-o", str(file)]) == 0
    tree = read_tree(file)
    found = failure(BIG_BLUE, "elevator", [one for one in elements(BIG_BLUE) if one.startswith(("pe:", "device:"))])
    assert Solution(tree.formula, tree.gates["elevator"]).by_order() == Solution(found.formula, found.root).by_order()
    assert main(["export", "openpsa", "big_blue", "elevator", "--mission", "-1"]) == 2
    assert "a number above 0" in capsys.readouterr().err


@needs_scram
def test_scram_agrees_on_drawn_trees(tmp_path: Path) -> None:
    compared = 0
    for seed, _, ours, theirs in races(iter(range(part_of(20, 4))), tmp_path):
        assert agree(ours, theirs), seed
        compared += ours.exact and theirs.by_order is not None
    assert compared >= part_of(20, 4) - 1


@needs_scram
def test_scram_agrees_on_the_shipped_aircraft(tmp_path: Path) -> None:
    for function in BIG_BLUE.functions:
        found = failure(BIG_BLUE, function, elements(BIG_BLUE))
        rates = dict.fromkeys(elements(BIG_BLUE), 0.001)
        file = written(tmp_path, fault_tree(function, found.formula, found.root, Hazards(rates), 10.0))
        ours, theirs = here(file), by_scram(file)
        assert theirs.by_order is not None
        # `here` takes an hour; the file says how long the mission is
        tree = read_tree(file)
        probability = Solution(tree.formula, tree.gates[tree.tops[0]]).probability(Hazards(tree.rates).chances(10.0))
        assert ours.by_order == theirs.by_order
        assert probability == pytest.approx(theirs.probability, rel=1e-5)
