"""The command line as a whole: help by what a person is about to do, one spelling for each thing, one code for each
mistake."""

import argparse
import io
import json
import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import pytest

from heronry_agent.shell.cli import main as pe_agent
from heronry_tools.cli import main
from heronry_tools.command_table import COMMANDS, GROUPS, HELP, add_parsers, run_of
from heronry_wire.command_parser import CommandParser

TEACHING = [name for name in COMMANDS if name != HELP]
ORDERS = (
    "phase",
    "priority",
    "fail",
    "clear",
    "retire",
    "restore",
    "reload",
    "unlock",
    "send-table",
    "adopt",
    "key",
    "bundle",
    "new",
)  # one sentence is all that they answer
STREAMS = ("demo", "manager", "top", "web")  # they print until they are ended; a shell's > keeps that
FORMATS = (
    "export",
    "render",
    "schema",
    "table",
    "dbc",
    "eds",
    "metrics",
    "record",
    "log",
    "combine",
)  # what they write is for programs already
WIRES = (
    "import",
    "softbus",
)  # it carries frames, and has no answer to anything


@pytest.fixture(autouse=True)
def _a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def ended_with(words: Sequence[str]) -> int:
    """Exit code of a command line, which argparse may end."""
    try:
        return main(words)
    except SystemExit as ended:
        return int(ended.code or 0)


def helped(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert ended_with(words) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Sentence with which a command line is refused."""
    assert ended_with(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1, err
    return err


def parser_of(name: str) -> CommandParser:
    subparsers = CommandParser(prog="heronry").add_subparsers()
    add_parsers(COMMANDS[name], subparsers)
    parser = subparsers.choices[name]
    assert isinstance(parser, CommandParser)
    return parser


def test_help_groups_all_commands_each_in_one_line_that_fits_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    lines = helped(capsys, "--help").splitlines()
    assert [line for line in lines if len(line) > 80] == []
    assert [line[:-1] for line in lines if re.fullmatch(r"[a-z ]+:", line)] == list(GROUPS)
    assert list(GROUPS) == ["start", "write a spec", "what if", "try", "deploy", "fly", "watch"]
    listed = [line.split()[0] for line in lines if line.startswith("  ")]
    assert listed == list(COMMANDS)
    assert len(set(listed)) == len(listed)


def test_a_name_that_could_mislead_has_a_line_that_does_not() -> None:
    for name in ("phase", "priority", "fail", "clear", "retire", "restore", "unlock"):
        assert COMMANDS[name].line.startswith("the operator's order: ")
    assert COMMANDS["bus"].line.startswith("planned traffic: ")


@pytest.mark.parametrize("words", [["help"], ["-h"], ["help", "--help"]])
def test_help_may_be_asked_for_in_other_ways(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert helped(capsys, *words) == helped(capsys, "--help")


def test_no_command_at_all_shows_the_commands_and_has_done_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    everything = helped(capsys, "--help")
    assert main([]) == 2
    assert capsys.readouterr() == ("", everything)


def test_both_programs_say_which_version_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert helped(capsys, "--version") == f"heronry {version('heronry')}\n"
    with pytest.raises(SystemExit, match="0"):
        pe_agent(["--version"])
    assert capsys.readouterr().out == f"pe-agent {version('heronry')}\n"


@pytest.mark.parametrize("name", TEACHING)
def test_help_with_a_command_is_that_commands_help_and_teaches_by_example(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = helped(capsys, "help", name)
    assert said == helped(capsys, name, "--help")
    assert f"  heronry {name}" in said[said.index("examples:") :]


def commands_of(line: str) -> Iterator[list[str]]:
    """Words of each command of a line of shell; where one's output goes, or its input comes from, is left out."""
    tokens = shlex.shlex(line, posix=True, punctuation_chars=True)
    tokens.whitespace_split = True
    words: list[str] = []
    is_kept = True
    for token in tokens:
        if token in ("|", "&&"):
            yield words
            words, is_kept = [], True
        elif token[0] in "<>":
            is_kept = False
        elif is_kept:
            words.append(token)
    yield words


def examples(name: str) -> Iterator[list[str]]:
    """Arguments of each example of any command in a command's help."""
    for line in str(parser_of(name).epilog).splitlines():
        command = re.split(r"\s{2,}", line.strip())[0]
        for words in commands_of(command) if command.startswith("heronry") else ():
            if words[:1] == ["heronry"] and words[1] in TEACHING:
                yield words[1:]


@pytest.mark.parametrize("name", TEACHING)
def test_every_example_is_a_command_line(name: str) -> None:
    found = list(examples(name))
    assert found
    for words in found:
        missing = {"diff": ["new"]}.get(words[0], []) if len(words) == 2 else []  # NEW was a <(...)
        parser_of(words[0]).parse_args(words[1:] + missing)


@pytest.mark.parametrize("name", TEACHING)
def test_a_command_is_in_the_file_that_the_table_says(name: str) -> None:
    subparsers = argparse.ArgumentParser().add_subparsers()
    add_parsers(COMMANDS[name], subparsers)
    assert set(subparsers.choices) == {one.name for one in COMMANDS.values() if one.module() == COMMANDS[name].module()}


@pytest.mark.parametrize("name", TEACHING)
def test_each_parser_names_a_function_that_runs_its_command(name: str) -> None:
    for parser in parsers_of(name):
        default = argparse.Namespace(**parser._defaults)
        assert callable(run_of(COMMANDS[name], default))


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["chekc"], "heronry: there is no command 'chekc'; did you mean 'check'?"),
        (["Plan", "big_blue"], "heronry: there is no command 'Plan'; did you mean 'plan'?"),
        (["xyzzy"], "heronry: there is no command 'xyzzy'; 'heronry --help' lists all commands"),
        (["help", "stauts"], "heronry: there is no command 'stauts'; did you mean 'status'?"),
        (["--verson"], "heronry: --verson cannot stand before a command; did you mean --version?"),
        (
            ["--json", "plan"],
            "heronry: --json cannot stand before a command; the command comes first: heronry COMMAND --json",
        ),
        (
            ["plan", "big_blue", "--dwon", "pe:nav"],
            "heronry plan: there is no option --dwon; did you mean --down?",
        ),
        (
            ["check", "--formt=json"],
            "heronry check: there is no option --formt; did you mean --format?",
        ),
        (
            ["plan", "big_blue", "--zzz"],
            "heronry plan: there is no option --zzz; see 'heronry plan --help'",
        ),
        (
            ["plan", "big_blue", "--js"],
            "heronry plan: there is no option --js; did you mean --json?",
        ),
        (["plan", "a", "b"], "heronry plan: 'b' is one argument too many; see 'heronry plan --help'"),
        (["plan", "--hlep"], "heronry plan: there is no option --hlep; did you mean --help?"),
        (["why", "--zzz"], "heronry why: SPEC, FUNCTION are missing; see 'heronry why --help'"),
        (["pcs", "cutt"], "heronry pcs: there is no command 'cutt'; did you mean 'cut'?"),
        (["log", "flight.log"], "heronry log: there is no command 'flight.log'; there is convert"),
        (["why", "a"], "heronry why: FUNCTION is missing; see 'heronry why --help'"),
        (["why"], "heronry why: SPEC, FUNCTION are missing; see 'heronry why --help'"),
        (
            ["plan", "a", "--planner", "exat"],
            "heronry plan: --planner: 'exat' is none of the choices; did you mean 'exact'?",
        ),
        (
            ["bound", "a", "--decide", "soon"],
            "heronry bound: --decide: 'soon' is not a number; see 'heronry bound --help'",
        ),
        (
            ["cutsets", "a", "b", "--order", "x"],
            "heronry cutsets: --order: 'x' is not a whole number; see 'heronry cutsets --help'",
        ),
        (
            ["demo", "-i", "socketcn"],
            "heronry demo: -i/--interface: 'socketcn' is none of the choices; did you mean 'socketcan'?",
        ),
        (
            ["explain", "lost-with-hardwar"],
            "heronry: there is no code 'lost-with-hardwar'; did you mean 'lost-with-hardware'?",
        ),
    ],
)
def test_a_slip_is_one_sentence_with_what_may_have_been_meant(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(capsys, *words) == f"{sentence}\n"


def test_a_misspelt_spec_is_compared_with_all_shipped_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", "eavv"]) == 2
    assert capsys.readouterr().err.endswith("(big_blue, elevator_and_chute, eav); did you mean 'eav'?\n")


@pytest.mark.parametrize("more", [["--node", "92"], []])
def test_the_agent_says_what_may_have_been_meant_as_well(more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        pe_agent(["--tabel", "nav.table", *more])
    assert capsys.readouterr().err == "pe-agent: there is no option --tabel; did you mean --table?\n"


@pytest.mark.parametrize("name", ["demo", "manager", "doctor", "scenario", "send-table"])
def test_no_usage_lists_the_interfaces_of_python_can(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = helped(capsys, name, "--help")
    assert "-i INTERFACE" in said
    assert "neousys" not in said


@pytest.mark.parametrize("name", TEACHING)
def test_machines_read_json_and_a_file_keeps_what_is_written(name: str) -> None:
    for parser in parsers_of(name):
        options = {option for action in parser._actions for option in action.option_strings}
        assert ("--json" in options) is (name not in (*FORMATS, *WIRES))
        assert ("-o" in options) is (name not in (*ORDERS, *STREAMS, *WIRES))


def parsers_of(name: str) -> list[argparse.ArgumentParser]:
    """The parser of a command, or those of its own commands, if it has some."""
    parser = parser_of(name)
    own = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return list(own[0].choices.values()) if own else [parser]


NO_SPEC = {  # the same mistake: a spec that is not there
    "check": ["check", "nosuch"],
    "render": ["render", "nosuch"],
    "pcs": ["pcs", "check", "nosuch"],
    "softbus": ["softbus", "nosuch/can0.sock"],
    "diff": ["diff", "big_blue", "nosuch"],
    "combine": ["combine", "eav", "nosuch", "--over", "radio"],
    "plan": ["plan", "nosuch"],
    "verify": ["verify", "nosuch", "plan.json"],
    "why": ["why", "nosuch", "elevator"],
    "bus": ["bus", "nosuch"],
    "bound": ["bound", "nosuch"],
    "campaign": ["campaign", "nosuch"],
    "cutsets": ["cutsets", "nosuch", "elevator"],
    "export": ["export", "openpsa", "nosuch", "elevator"],
    "import": ["import", "openpsa", "nosuch.xml"],
    "sim": ["sim", "nosuch"],
    "fly": ["fly", "nosuch"],
    "exhaust": ["exhaust", "nosuch"],
    "contingencies": ["contingencies", "nosuch", "-o", "made"],
    "table": ["table", "nosuch", "nav"],
    "adopt": ["adopt", "nosuch", "101"],
    "send-table": ["send-table", "nosuch", "nav"],
    "doctor": ["doctor", "nosuch"],
    "preflight": ["preflight", "nosuch"],
    "manager": ["manager", "nosuch", "-i", "virtual"],
    "demo": ["demo", "nosuch"],
    "module": ["module", "try", "nosuch:Speed"],
    "replay": ["replay", "nosuch.log", "nosuch"],
    "dbc": ["dbc", "nosuch"],
    "log": ["log", "convert", "nosuch.log", "big_blue", "-o", "flight.mcap"],
    # the same of other files and names
    "scenario": ["scenario", "nosuch.scenario"],
    "key": ["key", "--check", "nosuch.key"],
    "bundle": ["bundle", "inspect", "nosuch.bundle"],
    "new": ["new", "glider", "--in", "nosuch"],
    "explain": ["explain", "nosuch"],
    "rules": ["rules", "nosuch"],
    "status": ["status", "--of", "nosuch"],
    "top": ["top", "--json", "--of", "nosuch"],
    "record": ["record", "-o", "flight", "--of", "nosuch"],
    "metrics": ["metrics", "--of", "nosuch"],
    "web": ["web", "--of", "nosuch"],
    "fail": ["fail", "--of", "nosuch", "pe:nav"],
    "traceback": ["traceback", "--of", "nosuch", "module:autopilot"],
    "clear": ["clear", "--of", "nosuch", "pe:nav"],
    "phase": ["phase", "--of", "nosuch", "glide"],
    "priority": ["priority", "--of", "nosuch", "imaging", "7"],
    "retire": ["retire", "--of", "nosuch", "pe:nav"],
    "restore": ["restore", "--of", "nosuch", "pe:nav"],
    "unlock": ["unlock", "--of", "nosuch", "pe:nav"],
    "reload": ["reload", "--of", "nosuch", "big_blue"],
}
NAMES_NOTHING = ("schema", "eds")


@pytest.mark.parametrize("name", TEACHING)
def test_what_is_not_there_ends_every_command_with_2(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    if name in NAMES_NOTHING:
        assert name not in NO_SPEC
        return
    assert "nosuch" in refused(capsys, *NO_SPEC[name])
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "big_blue", "--down", "pe:nosuch"],
        ["verify", "big_blue", "-", "--down", "pe:nosuch"],
        ["why", "big_blue", "elevator", "--down", "pe:nosuch"],
        ["bus", "big_blue", "--down", "pe:nosuch"],
        ["render", "big_blue", "--down", "pe:nosuch"],
        ["plan", "big_blue", "--phase", "nosuch"],
        ["bus", "big_blue", "--phase", "nosuch"],
        ["bound", "big_blue", "--phase", "nosuch"],
        ["campaign", "big_blue", "--phase", "nosuch"],
        ["cutsets", "big_blue", "elevator", "--phase", "nosuch"],
        ["why", "big_blue", "nosuch"],
        ["cutsets", "big_blue", "nosuch"],
        ["render", "big_blue", "--function", "nosuch"],
        ["table", "big_blue", "nosuch"],
        ["check", "--select", "nosuch"],
        ["sim", "big_blue", "--kill", "pe:nosuch@1"],
    ],
)
def test_a_name_that_is_not_there_ends_every_command_with_2(
    words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO('{"modules": {}}'))
    assert "nosuch" in refused(capsys, *words)


@pytest.mark.parametrize("name", ["plan", "manager", "sim"])
def test_a_table_in_the_place_of_a_spec_is_told_from_one(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    sentence = "heronry: nav.table: a table is what 'heronry table' compiles from a spec; name the *.dg.yaml itself\n"
    assert refused(capsys, name, "nav.table") == sentence


def test_o_takes_what_would_be_printed(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["plan", "elevator_and_chute"], ["bus", "elevator_and_chute", "--json"], ["explain", "DG401"]):
        printed = helped(capsys, *words)
        assert helped(capsys, *words, "-o", "kept") == ""
        assert Path("kept").read_text() == printed


def test_the_ending_of_the_file_chooses_the_form(capsys: pytest.CaptureFixture[str]) -> None:
    helped(capsys, "plan", "elevator_and_chute", "-o", "plan.json")
    assert json.loads(Path("plan.json").read_text())["spec"]
    assert helped(capsys, "verify", "elevator_and_chute", "plan.json") == "legal: no rule is broken\n"
    helped(capsys, "render", "elevator_and_chute", "-o", "graph.mmd")
    assert Path("graph.mmd").read_text().startswith("flowchart")
    helped(capsys, "check", "elevator_and_chute", "-o", "found.sarif")
    assert json.loads(Path("found.sarif").read_text())["version"] == "2.1.0"
    helped(capsys, "check", "elevator_and_chute", "--format", "sarif", "-o", "found.json")
    assert Path("found.json").read_text() == Path("found.sarif").read_text()
    helped(capsys, "campaign", "elevator_and_chute", "--faults", "0", "--jobs", "1", "-o", "page.html")
    assert Path("page.html").read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["render", "elevator_and_chute", "-o", "g.png"],
            "g.png: this command writes no PNG; convert an SVG: -o g.svg, then rsvg-convert -f png -o g.png g.svg",
        ),
        (
            ["render", "elevator_and_chute", "--format", "svg", "-o", "g.PDF"],
            "g.PDF: this command writes no PDF; convert an SVG: -o g.svg, then rsvg-convert -f pdf -o g.PDF g.svg",
        ),
        (
            ["diff", "big_blue", "big_blue", "-o", "d.png"],
            "d.png: this command writes no PNG; what it writes ends in .json, .mmd, .mermaid, .txt",
        ),
        (
            ["render", "elevator_and_chute", "--format", "dot", "-o", "g.svg"],
            "g.svg would be written as dot, but its ending is that of svg; name another file",
        ),
        (
            ["plan", "elevator_and_chute", "-o", "plan.svg"],
            "plan.svg: this command writes no SVG; what it writes ends in .json, .txt",
        ),
        (["dbc", "-o", "bus.JSON"], "bus.JSON: this command writes no JSON; what it writes ends in .dbc"),
        (["schema", "-o", "schema.html"], "schema.html: this command writes no HTML; what it writes ends in .json"),
        (
            ["contingencies", "elevator_and_chute", "-o", "made.json"],
            "made.json: this command writes no JSON; what it writes ends in .contingencies",
        ),
        (
            ["contingencies", "elevator_and_chute", "-o", "my.dg.yaml"],
            "my.dg.yaml: a file with this ending is a spec, and no command writes specs; name another file",
        ),
        (
            ["demo", "elevator_and_chute", "--record", "my.dg.yaml"],
            "my.dg.yaml: a file with this ending is a spec, and no command writes specs; name another file",
        ),
    ],
)
def test_a_file_that_would_hold_something_else_is_refused(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(capsys, *words) == f"heronry: {sentence}\n"
    assert list(Path().iterdir()) == []


def test_a_command_that_fails_leaves_the_file_as_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    Path("kept.json").write_text("before")
    refused(capsys, "plan", "elevator_and_chute", "--down", "pe:nosuch", "-o", "kept.json")
    assert Path("kept.json").read_text() == "before"
    assert [file.name for file in Path().iterdir()] == ["kept.json"]


def test_an_answer_of_no_is_kept_as_well(capsys: pytest.CaptureFixture[str]) -> None:
    Path("wrong.dg.yaml").write_text("dg: 1\n")
    assert main(["check", "wrong.dg.yaml", "-o", "found.json"]) == 1
    assert json.loads(Path("found.json").read_text())
    assert capsys.readouterr() == ("", "")


def test_an_order_answers_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    helped(capsys, "key", "fleet.key")
    told = json.loads(helped(capsys, "key", "--check", "fleet.key", "--json"))
    assert told.keys() == {"file", "fingerprint"}
    rule = json.loads(helped(capsys, "explain", "dg401", "--json"))
    assert (rule["code"], rule["name"]) == ("DG401", "lost-with-hardware")
