"""`heronry adopt`: what a node offers becomes the lines of a spec."""

import json
from pathlib import Path

import pytest

from heronry_agent.shell.offer import offer
from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main
from heronry_tools.commands.adopt import read_offer, spec_lines
from heronry_tools.console.errors import UserError

SPEC, NODE = "elevator_and_chute", 101


def test_the_lines_make_a_spec_that_has_the_node() -> None:
    path = shipped_spec_path(SPEC)
    lines = spec_lines(load(path), NODE, read_offer(offer(), NODE))
    text = path.read_text().replace("pes:\n", "pes:\n" + "\n".join(lines) + "\n")
    pe = loads(text, "more.dg.yaml").pes[f"node_{NODE}"]
    assert (pe.node_id, pe.buses) == (NODE, ("can0",))
    assert pe.cpu_millis >= 1000
    assert "images of elevator_and_chute on it: angle_driver, " in lines[1]


@pytest.mark.parametrize("text", ["", "[]", "{}", "no JSON", json.dumps({**json.loads(offer()), "cores": 0})])
def test_what_is_no_offer_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="node 101 offers nothing: start its agent with --node"):
        read_offer(text, NODE)


def test_a_line_break_in_an_offer_cannot_become_a_line_of_the_spec() -> None:
    for key, value in (("machine", "arm\n  evil: 1"), ("images", ["a\nb"])):
        with pytest.raises(UserError):
            read_offer(json.dumps({**json.loads(offer()), key: value}), NODE)


def test_a_node_that_is_in_the_spec_is_not_adopted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["adopt", SPEC, "94", "-i", "softbus", "-c", str(tmp_path / "none.sock")]) == 2
    assert "node 94 is tail_pe in elevator_and_chute already" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["adopt", SPEC, "9", "-i", "softbus", "-c", "x"])
    assert "use 92 to 125" in capsys.readouterr().err
