"""`heronry check`, `rules`, `explain` and `schema` as a person or a CI uses them: output and exit codes."""

import io
import json
import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from heronry_dg.check.examples import SOUND
from heronry_dg.check.json_schema import schema_text
from heronry_tools.analysis.check import registry
from heronry_tools.cli import main

ROOT = Path(__file__).parents[2]
SPARE = SOUND.replace("  speed: {type: FLOAT}\n", "  speed: {type: FLOAT}\n  spare: {type: FLOAT}\n")  # a warning
MISSPELT = SOUND.replace("needs: speed", "needs: sped")  # an error

Write = Callable[[str], str]


@pytest.fixture(autouse=True)
def plain_shell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_spec(text: str) -> str:
        Path("wing.dg.yaml").write_text(text)
        return "wing.dg.yaml"

    return write_spec


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(["check", "--fast", *arguments])
    return code, capsys.readouterr().out


def test_quiet_tells_errors_and_counts_warnings(capsys: pytest.CaptureFixture[str], write: Write) -> None:
    assert said(capsys, write(SPARE), "--quiet") == (0, "1 spec checked: 1 warning\n")
    code, out = said(capsys, write(SPARE), "--quiet", "--strict", "--format", "concise")
    assert (code, out[:23]) == (1, "wing.dg.yaml:11:3: DG24")
    broken = SPARE.replace("needs: speed", "needs: {and: [speed, {or: {k: 0, of: [spare]}}]}")
    code, out = said(capsys, write(f"gates: {{one: speed}}  # dg: ignore[DG240] never\n{broken}"), "-q")
    assert (code, out.count("DG"), out.splitlines()[-1]) == (1, 1, "1 spec checked: 1 error and 1 warning")


def test_an_error_is_shown_with_its_line_a_caret_and_a_remedy(capsys: pytest.CaptureFixture[str], write: Write) -> None:
    code, out = said(capsys, write(MISSPELT))
    assert code == 1
    assert out == (
        "wing.dg.yaml:13:34: DG201 error: no variable or gate is named 'sped'\n"
        "13 |   display: {device: lamp, needs: sped, cpu: 0.1, ram: 1KiB, rate_hz: 10}\n"
        "   |                                  ^^^^\n"
        "  = hint: did you mean 'speed'?\n"
        "\n"
        "1 spec checked: 1 error\n"
    )


def test_a_warning_lets_the_check_pass_unless_it_is_strict(capsys: pytest.CaptureFixture[str], write: Write) -> None:
    file = write(SPARE)
    line = "wing.dg.yaml:11:3: DG240 {}: variable 'spare' is read by no module and watched by no phase"
    line += " (remove the variable, or let a module read it)\n"
    assert said(capsys, file, "--format", "concise") == (0, line.format("warning"))
    for option in (["--strict"], ["--error", "DG240"], ["--error", "DG2"]):
        assert said(capsys, file, "--format", "concise", *option) == (1, line.format("error"))


@pytest.mark.parametrize(
    ("options", "codes"),
    [
        ([], ["DG240", "DG243"]),
        (["--select", "DG240"], ["DG240"]),
        (["--select", "DG1,DG243"], ["DG243"]),
        (["--ignore", "DG24"], []),
        (["--select", "DG2", "--ignore", "DG240"], ["DG243"]),
        (["--ignore", "DG2"], []),
    ],
)
def test_codes_are_selected_and_ignored_by_how_they_begin(
    capsys: pytest.CaptureFixture[str], write: Write, options: list[str], codes: list[str]
) -> None:
    _, out = said(capsys, write(SPARE + "gates: {both: speed}\n"), "--format", "json", *options)
    assert [finding["code"] for finding in json.loads(out)] == codes


def test_what_stops_a_spec_from_being_loaded_is_reported_whatever_was_selected(
    capsys: pytest.CaptureFixture[str], write: Write
) -> None:
    code, out = said(capsys, write(MISSPELT), "--select", "DG0", "--ignore", "DG201", "--format", "concise")
    assert code == 1
    assert "DG201" in out


def test_specs_are_found_below_folders_but_not_in_hidden_ones(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a/one.dg.yaml", "a/b/two.dg.yaml", "a/.venv/three.dg.yaml", "a/other.yaml"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(MISSPELT)
    _, out = said(capsys, "--format", "json")
    assert [finding["file"] for finding in json.loads(out)] == ["a/one.dg.yaml", "a/b/two.dg.yaml"]
    _, out = said(capsys, "a", "a/one.dg.yaml", "--format", "json")
    assert len(json.loads(out)) == 2  # a file that is named twice is checked once


def test_a_spec_may_come_by_standard_input(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(MISSPELT.encode())))
    code, out = said(capsys, "-", "--format", "concise")
    assert code == 1
    assert out.startswith("<stdin>:13:34: DG201 error:")


def test_a_file_that_is_named_and_not_there_cannot_be_used(capsys: pytest.CaptureFixture[str], write: Write) -> None:
    assert main(["check", "missing.dg.yaml", write(SPARE)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("heronry: missing.dg.yaml: there is no such file, folder or shipped spec; name ")


def test_a_file_that_cannot_be_read_below_a_folder_is_a_finding_among_others(
    capsys: pytest.CaptureFixture[str], write: Write
) -> None:
    write(SPARE)
    Path("gone.dg.yaml").symlink_to("nowhere")
    code, out = said(capsys, ".", "--format", "concise")
    assert code == 1
    assert "gone.dg.yaml:1:1: DG001 error: the file cannot be read: No such file or directory" in out
    assert "DG240" in out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["."], "there is no *.dg.yaml in this folder"),
        (["--select", "DG999", "-"], "--select: no code begins with 'DG999'"),
        (["--error", "x", "-"], "--error: no code begins with 'x'"),
        (["-o", "no/such/folder/file", "big_blue"], "no/such/folder is not a folder; make this folder first"),
    ],
)
def test_wrong_usage_is_one_sentence_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    assert main(["check", "--fast", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_no_codes_at_all_is_wrong_usage_too(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["check", "--select", ""])
    assert "write codes or beginnings of codes" in capsys.readouterr().err


def test_a_defect_of_ours_is_one_sentence_and_exit_code_3(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, write: Write
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(registry, "CHECKS", {"DG2": fail})
    assert main(["check", "--fast", write(SPARE)]) == 3
    told = capsys.readouterr().err
    assert "wing.dg.yaml: heronry itself failed here (ZeroDivisionError at test_check_command.py:" in told
    assert "Traceback" not in told


def test_a_family_that_solves_says_what_is_missing_where_there_is_no_solver(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, write: Write
) -> None:
    def need_a_solver(*_: object) -> None:
        raise ModuleNotFoundError(name="ortools")

    monkeypatch.setattr(registry, "CHECKS", {"DG3": need_a_solver})
    assert main(["check", write(SPARE)]) == 2
    assert (
        "the rules that need a solver cannot be checked without ortools: install heronry[manager], or use --fast"
        in capsys.readouterr().err
    )


def test_github_is_the_format_where_github_runs_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, write: Write
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    _, out = said(capsys, write(MISSPELT))
    assert out.startswith("::error file=wing.dg.yaml,line=13,")


def test_a_report_can_be_written_to_a_file(capsys: pytest.CaptureFixture[str], write: Write) -> None:
    assert said(capsys, write(MISSPELT), "-o", "report.json", "--format", "json") == (1, "")
    assert json.loads(Path("report.json").read_text())[0]["code"] == "DG201"


@pytest.mark.parametrize(("variables", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_colours_are_for_terminals(write: Write, variables: dict[str, str], coloured: bool) -> None:
    ours, theirs = pty.openpty()
    environment = {key: value for key, value in os.environ.items() if key != "NO_COLOR"} | variables
    command = [sys.executable, "-m", "heronry_tools", "check", "--fast", write(MISSPELT)]
    subprocess.run(command, stdout=theirs, env=environment, check=False)
    os.close(theirs)
    shown = os.read(ours, 10_000)
    os.close(ours)
    assert b"DG201 error" in shown
    assert (b"\x1b[" in shown) == coloured


def test_a_spec_of_a_flight_is_known_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "eav", "--fast"]) == 0
    assert "nothing wrong" in capsys.readouterr().out


def test_many_findings_begin_with_their_number_of_each_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "elevator_and_chute"]) == 0
    assert re.match(r" +\d+ DG\d{3} warning  \w", capsys.readouterr().out)


def test_shipped_specs_have_no_findings(capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, str(ROOT / "dg_specs"), "--strict", "--format", "concise") == (0, "")
    assert said(capsys, "big_blue", "--format", "concise") == (0, "")


def test_rules_are_listed_and_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line[:5] for line in listed] == list(registry.RULES)
    assert main(["rules", "--json"]) == 0
    assert {rule["code"] for rule in json.loads(capsys.readouterr().out)} == registry.RULES.keys()
    for rule in registry.RULES.values():
        assert main(["explain", rule.code]) == main(["explain", rule.name]) == 0
        told = capsys.readouterr().out
        assert told.startswith(f"{rule.code} {rule.name} ({rule.severity}")
        assert rule.what in told
        assert rule.why in told
        assert rule.fix in told
    assert main(["explain", "DG999"]) == 2
    assert "there is no code 'DG999'" in capsys.readouterr().err


def test_the_list_of_one_rule_says_which_command_has_more(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "dg401"]) == 0
    row, _, more = capsys.readouterr().out.splitlines()
    assert row.startswith("DG401  ")
    assert more == "'heronry explain DG401' has more: why it matters, how to mend it, and an example"
    assert main(["rules", "DG4", "DG5"]) == 0
    assert [line[:5] for line in capsys.readouterr().out.splitlines()] == [
        code for code in registry.RULES if code.startswith(("DG4", "DG5"))
    ]
    assert main(["rules", "DG401", "--json"]) == 0
    assert [rule["code"] for rule in json.loads(capsys.readouterr().out)] == ["DG401"]
    assert main(["rules", "DG401", "dg999"]) == 2
    assert "no code of 'heronry check' begins with 'dg999'; 'heronry rules' lists all codes" in capsys.readouterr().err
    assert main(["rules", "DG4", "--format", "markdown"]) == 2
    assert "leave the codes out" in capsys.readouterr().err


def test_the_page_of_rules_is_current(capsys: pytest.CaptureFixture[str]) -> None:
    """Otherwise: heronry rules -o docs/rules.md."""
    assert main(["rules", "--format", "markdown"]) == 0
    page = capsys.readouterr().out
    assert (ROOT / "docs/rules.md").read_text() == page
    assert all(f"### {rule.code} {rule.name}\n" in page for rule in registry.RULES.values())


def test_the_shipped_schema_is_current(capsys: pytest.CaptureFixture[str]) -> None:
    """Otherwise: heronry schema >dg_specs/dg.schema.json."""
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == schema_text() == (ROOT / "dg_specs/dg.schema.json").read_text()


def test_the_fast_families_need_what_the_hook_installs_and_no_more(write: Write) -> None:
    """Run the hook's own command with everything of the other extras gone."""
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    program, *arguments = hook["entry"].split()
    assert program == "heronry"
    code = f"""
import sys
sys.modules.update(dict.fromkeys(["ortools", "rich", "cantools", "numpy"]))  # None: importing it fails
from heronry_tools.cli import main
code = main({[*arguments, write(MISSPELT)]!r})
assert not any(name.startswith("heronry_manager") for name in sys.modules)
sys.exit(code)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (1, "")
    assert "DG201" in run.stdout


def test_without_its_extra_the_check_says_what_to_install(write: Write) -> None:
    code = f"""
import sys
sys.modules.update(dict.fromkeys(["pydantic", "yaml"]))
from heronry_tools.cli import main
sys.exit(main(["check", "--fast", {write(SPARE)!r}]))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert re.fullmatch(r"heronry: (pydantic|yaml) is not installed; .* pip install \"heronry\[check\]\"\n", run.stderr)


def test_the_guide_knows_every_family() -> None:
    guide = (ROOT / "docs/check.md").read_text()
    for family in registry.FAMILIES:
        solves = "| |" if family.fast else "| yes |"
        assert re.search(rf"^\| {family.prefix} \|.*{re.escape(solves)}$", guide, re.MULTILINE), family.prefix
