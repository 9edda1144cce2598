"""The documentation does what it says: every command line of its pages (DOCUMENTS) is run here.

Command lines are those of fenced sh, bash and console blocks (in a console block, the lines after `$ `). The lines of
one document run in order, in one copy of the checkout without its `.venv`, so that a line finds the files that an
earlier one wrote. RULES says how each command is tried; a command without a rule fails. A shell gets every line in
`make soak`; in `make test` the first line of README.md for each program, and those that no program understands without
a shell, and the programs of the others are called in this process. A command that running text mentions must exist in
the `--help` of its program, with its options.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from enum import Enum
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO, TextIOWrapper
from itertools import takewhile
from pathlib import Path

import pytest

from heronry_agent.shell.cli import main as pe_agent
from heronry_tools.cli import main as heronry
from thoroughness import IS_WHOLE, mostly_soak

OWN_PROGRAMS: dict[str, Callable[[], object]] = {"heronry": heronry, "pe-agent": pe_agent}
CHECKOUT = Path.cwd()
README = Path("README.md")
DOCUMENTS = [README, Path("CONTRIBUTING.md"), *sorted(Path("docs").rglob("*.md")), Path("tests/lab/README.md")]
TIMEOUT_S = 180

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MENTION = re.compile(r"`((heronry [a-z]+|pe-agent|make [a-z]+|tools/[a-z-]+|python -m [a-z_.]+)( [^`\n]+)?)`")
WRITTEN = re.compile(r"(?:-o |--write |>\s?)(\S+)")
NOTE = re.compile(r"\d\d:\d\d:\d\d\.\d{3} ")  # the log of an agent
LINK = re.compile(r"\]\((?!\w+:|#)([^)#]+)[^)]*\)")


class How(Enum):
    """How a command line is tried."""

    RUN = "it runs, and ends with 0"
    LIVE = "as RUN, but with processes or for seconds: marker live"
    HARDWARE = "it needs a bus that only its user has: it gets as far as not finding that"
    EXEMPT = "it is not tried here"


@dataclass(frozen=True)
class Rule:
    """How to try the command lines that match; the first rule that matches counts."""

    pattern: str
    how: How
    reason: str = ""
    more: str = ""  # what makes it short: options that its --help documents
    is_long: bool = False  # make soak alone tries it
    in_checkout: bool = False  # make works on the .venv of the checkout


# A demo that finds no plans makes them behind the flight, with all processors, for the next demo: of that test_demo.py
# has a test. `make soak` types what is written. In `make test` one demo of the documents flies, `make demo`; the others
# get as far as to their bus, and by then all of their words are understood. Their stories fly in test_demo.py.
FLIES_ALONE = "" if IS_WHOLE else "--contingencies none"
NO_INTERFACE = "nocan0"  # stands for the user's own: no test talks to a real aircraft


def demo_rule(pattern: str, more: str = "") -> Rule:
    """How to try demos."""
    if IS_WHOLE:
        return Rule(pattern, How.LIVE, more=more)
    return Rule(pattern, How.HARDWARE, "a CAN interface", more=f"{FLIES_ALONE} -i socketcan -c {NO_INTERFACE}")


RULES = [
    Rule(r"make (test|lint)", How.EXEMPT, "they run this very test, and have run the linters already"),
    Rule(r"make demo ARGS=--web", How.EXEMPT, "it goes on until Ctrl-C; tests/live/test_demo_page.py flies it"),
    Rule(r"make demo", How.LIVE, more=f"ARGS='--for 2 {FLIES_ALONE}'", in_checkout=True),
    Rule(r"make( help)?", How.RUN, in_checkout=True),
    Rule(r"(heronry|pe-agent|tools/with-vcan)( \w+)? --help", How.RUN),
    Rule(r"heronry reload .*", How.EXEMPT, "it needs an aircraft that flies; tests/live/test_reload.py has one"),
    Rule(
        r"(heronry|sed) .*\b(my|own)\.dg\.yaml.*|heronry module try my_estimator:.*",
        How.EXEMPT,
        "test_tutorial.py runs it, on what is written by then; tests/live/test_demo.py flies it",
    ),
    Rule(
        r".*(heronry (manager|demo|send-table|adopt|bundle send)|pe-agent) .*-c can\d.*",
        How.HARDWARE,
        "a CAN interface named can0",
    ),
    Rule(r"ssh .*", How.EXEMPT, "another computer"),
    Rule(r"ip link .*|for pe in .*|python3 -m venv .*|.*pip install .*|export PATH=.*", How.EXEMPT, "test_desk.py"),
    Rule(r"(heronry|pe-agent) .*-c vcan0.*", How.EXEMPT, "tests/live/test_desk.py runs the whole page"),
    Rule(r"python -m lab\.benches\.node.*", How.LIVE, more="--seconds 1 --busy 1", is_long=True),
    Rule(r"python -m lab\.benches\.rest.*", How.LIVE, more="--seconds 1 --settle 0", is_long=True),
    Rule(
        r"python -m lab\.benches\.agent.*",
        How.LIVE,
        more="--seconds 1 --busy 1 --spec elevator_and_chute",
        is_long=True,
    ),
    Rule(r"tools/make-wheelhouse .*", How.EXEMPT, "it fetches packages"),
    Rule(r"pip wheel .*", How.EXEMPT, "it fetches the build system; test_small_install.py builds the wheel"),
    demo_rule(r"heronry demo\b.*--web.*", "--for 2"),
    Rule(r"heronry web\b.*", How.EXEMPT, "it serves until it is stopped; tests/web opens its pages"),
    Rule(r"heronry top( --log flight.log big_blue)?|heronry top --log flight", How.EXEMPT, "tests/watch/test_top.py"),
    Rule(r"heronry (top|metrics|log convert) .*flight\.log big_blue.*", How.EXEMPT, "tests/watch flies and runs them"),
    Rule(r"heronry (record|log convert|replay) .*\bflight\b.*", How.EXEMPT, "tests/watch and tests/live record one"),
    Rule(r"heronry metrics --port .*", How.EXEMPT, "tests/live/test_watching_live.py scrapes it"),
    demo_rule(r"heronry demo\b.*"),
    Rule(r"heronry scenario\b.*both_computers_die.* -i softbus", How.EXEMPT, "test_scenario_live.py flies it"),
    Rule(r"heronry scenario\b.*", How.RUN),
    Rule(r"heronry sim .*--compiled.*", How.EXEMPT, "the first time it compiles for minutes"),
    Rule(r"heronry sim (big_blue|elevator_and_chute --runs 3 .*)", How.RUN, is_long=True),
    Rule(r"heronry sim big_blue .*", How.RUN, more="--seconds 1 --kill pe:nav@0.5"),  # drawn faults would last longer
    Rule(r"heronry sim .*", How.RUN, more="--seconds 1"),
    Rule(r"heronry fly big_blue( --report .*)?", How.EXEMPT, "an hour of flight; test_big_blue_flights.py, when long"),
    Rule(r"heronry fly .*--live.*", How.LIVE, is_long=True),
    Rule(r"heronry fly .*", How.RUN, is_long=True),  # fly/test_eav_flights.py flies and draws one
    Rule(r"heronry check( big_blue| eav| --error .*)?", How.RUN, more="--fast"),  # make lint checks all completely
    Rule(r"heronry pcs (apply .* --live|release)", How.EXEMPT, "tests/live/test_live_script.py flies scripts"),
    Rule(r"heronry diff HEAD:dg_specs/big_blue.*", How.RUN, is_long=True),  # render.md has it with a smaller spec
    Rule(
        r"heronry (combine|diff) dg_specs/flights/.*", How.RUN, is_long=True
    ),  # test_combine_command.py combines these
    Rule(r"heronry (plan|verify|table|dbc|eds|check|render|diff|pcs)\b.*", How.RUN),
    Rule(r"heronry key \w+\.key|heronry new glider", How.RUN),
    Rule(r"heronry module try (state_estimator|pitch_trim) .*", How.RUN),
    Rule(r"heronry bus dg_specs/examples/.*", How.RUN),
    Rule(r"python -m lab\.checkpoints\.kills.*", How.RUN, more="--kills 2", is_long=True),
    Rule(r"python -m lab\.checkpoints\.landings.*", How.RUN, more="--seeds 1", is_long=True),
    Rule(r"python -m lab\.checkpoints\.live.*", How.EXEMPT, "tests/live/test_checkpoints.py flies it"),
    Rule(r"heronry (key --signing|bundle (build|sign|inspect)) .*", How.EXEMPT, "test_bundle_command.py runs them"),
    Rule(r"heronry exhaust\b.* --count", How.RUN, is_long=True),  # test_exhaust_command.py counts
    Rule(r"heronry exhaust\b.*", How.RUN, more="--sample 2 --pairs 1"),
    Rule(r"python -m lab\.benches\.endurance\b.*", How.RUN, more="--hours 0.002 --reboots 3", is_long=True),
    Rule(r"python -m lab\.benches\.reaction --write .*", How.RUN),
    Rule(r"python -m lab\.benches\.reaction\b.*", How.EXEMPT, "test_reaction_bench.py flies it"),
    Rule(r"python -m lab\.benches\.reconfiguration .*", How.LIVE, more="--kills 1", is_long=True),
    Rule(r"heronry (contingencies|campaign|cutsets|why|export|import)\b.*", How.RUN),
    Rule(r"PYTHONPATH=tests python -m reliability\.(brute_force|systems) .*", How.EXEMPT, "tests/reliability runs it"),
    Rule(r"python -m lab\.fault_tree_race", How.EXEMPT, "tests/reliability runs it where there is a scram"),
    Rule(
        r"python -m lab.planner_race\b.*", How.RUN, more="--sizes 30x8 --cases 1 --seed 2 --effort 0.01", is_long=True
    ),
    Rule(r"PYTHONPATH=tests python -m planner\.(comparison|mutants) .*", How.EXEMPT, "tests/planner runs them"),
    Rule(r"heronry (bus|bound)\b.*|python -m lab\.benches\.bus\b.*", How.RUN),
    Rule(r"pytest tests/.*", How.EXEMPT, "make test runs it"),
    Rule(r"python -m lab\.benches\.component_graphs.*", How.RUN, more="--runs 1", is_long=True),
    Rule(r"python -m lab\.benches\.takeover.*", How.RUN, more="--seeds 1 --kills 0"),
    Rule(r"heronry preflight\b.*", How.EXEMPT, "tests/live/test_preflight.py runs it beside a flight"),
    Rule(
        r"heronry (status|phase|priority|fail|clear|unlock|traceback)\b.*",
        How.EXEMPT,
        "tests/live/test_operator.py gives it to a manager",
    ),
    Rule(r"heronry (retire|restore)\b.*", How.EXEMPT, "tests/live/test_tables_by_themselves.py retires a PE"),
    Rule(r"python -m lab\.(fuzz|attack)\b.*", How.RUN, more="" if IS_WHOLE else "--count 20"),
    Rule(r"python -m lab\.conformance pe_staging|python -m lab\.cut_set_enumeration\b.*", How.RUN),
    Rule(r"python -m lab\.mutation .* --list", How.RUN),
    Rule(r"python -m lab\.code_flights\b.*", How.RUN, more="--runs 1"),
    Rule(r"python -m lab\.scripts_in_flight\b.*", How.RUN, more="--runs 1 --seconds 1"),
    Rule(r"python -m lab\.conformance\b.*", How.EXEMPT, "test_conformance.py plays them"),
    Rule(r"tools/mutate --seed \d+.*", How.EXEMPT, "for half an hour; test_mutation.py tries it on little"),
    Rule(r"sed .* dg_specs/.*", How.RUN),  # makes a file to try a command on
]
READ_ONLY = ("manager", "pe_agent", "tools")
SOURCES = tuple(folder.name for folder in Path("tests").iterdir() if folder.is_dir() and folder.name != "scenarios")
PLANNING_AHEAD = ("heronry: planning ", "heronry: waiting for another process that plans ahead")


@dataclass(frozen=True)
class CommandLine:
    """One command line of a document, and where it stands."""

    place: str
    text: str

    @property
    def rule(self) -> Rule | None:
        return next((rule for rule in RULES if re.fullmatch(rule.pattern, without_redirection(self.text))), None)


def without_redirection(text: str) -> str:
    """The command itself: without comment, and without where its output goes."""
    words = shlex.split(re.sub(r"\s*>\s*\S+", "", text), comments=True)
    return " ".join(words)


def command_lines(document: Path) -> Iterator[CommandLine]:
    """Every command line of a document, in order."""
    text = document.read_text()
    for block in FENCE.finditer(text):
        if block[1] not in ("sh", "bash", "console", "shell"):
            continue
        first = text.count("\n", 0, block.start(2)) + 1
        for number, line in enumerate(block[2].replace("\\\n", " ").splitlines(), first):
            command = line.removeprefix("$ ").strip()
            is_output = block[1] == "console" and not line.startswith("$ ")
            if command and not command.startswith("#") and not is_output:
                yield CommandLine(f"{document}:{number}", command)


def all_lines() -> list[CommandLine]:
    return [line for document in DOCUMENTS for line in command_lines(document)]


def mentions() -> list[tuple[str, str, str]]:
    """Commands in running text: document, program with its subcommand, and the rest."""
    return sorted(
        {
            (str(document), mention[2], mention[3] or "")
            for document in DOCUMENTS
            for mention in MENTION.finditer(FENCE.sub("", document.read_text()))
        }
    )


def typed(text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What happens when a user types this in a folder, with `.venv/bin` on the path."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-eo", "pipefail", "-c", text],
        cwd=folder,
        env={**os.environ, "PATH": path, "COLUMNS": "300"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


def called(text: str, folder: Path) -> subprocess.CompletedProcess[str] | None:
    """The same in this process, since another one would import for a second; None where that takes a shell."""
    written = re.search(r">\s*(\S+)", text)
    command = re.sub(r"\s*>\s*\S+", "", text)
    words = shlex.split(command)
    program, given = (words[:3], words[3:]) if words[:2] == ["python", "-m"] else (words[:1], words[1:])
    main = main_of(" ".join(program))
    if main is None or re.search(r"[|&;<$`*~]", command):
        return None
    out, err = (TextIOWrapper(BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.setenv("COLUMNS", "300")
        patch.setattr(sys, "argv", [" ".join(program), *given])
        code = exit_code_of(main)
    said, complained = (stream.buffer.getvalue().decode() for stream in (out, err))
    if written is not None:
        (folder / written[1]).write_text(said)
    return subprocess.CompletedProcess(words, code, said, complained)


def exit_code_of(main: Callable[[], object]) -> int:
    """What a shell would get from a program that has this `main`."""
    try:
        code = main()
    except SystemExit as ended:
        code = ended.code
    return code if isinstance(code, int) else int(code is not None)


def tried(line: CommandLine, rule: Rule, workspace: Path, *, in_a_shell: bool = True) -> str | None:
    """Run a command line; what is wrong with it, or None."""
    text = f"{re.sub(' +# .*', '', line.text)} {rule.more}".strip()
    if rule.how is How.HARDWARE:
        text = re.sub(r"-c can\d", f"-c {NO_INTERFACE}", text)
    folder = CHECKOUT if rule.in_checkout else workspace
    ended = (None if in_a_shell else called(text, folder)) or typed(text, folder)
    if rule.how is How.HARDWARE:
        said = [
            text for text in ended.stderr.splitlines() if not text.startswith(PLANNING_AHEAD) and not NOTE.match(text)
        ]
        understood = ended.returncode != 0 and len(said) == 1 and NO_INTERFACE in said[0]
        return None if understood else f"{line.place}: `{text}` did not get as far as the bus: {ended.stderr[-500:]}"
    return (
        None
        if ended.returncode == 0
        else f"{line.place}: `{text}` ended with {ended.returncode}: {ended.stderr[-500:]}"
    )


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A copy of the checkout, without what tools have left in it; folders to which no document writes are linked."""
    left_out = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "htmlcov", *READ_ONLY, *SOURCES)
    folder = Path(shutil.copytree(CHECKOUT, tmp_path / "heronry", ignore=left_out, symlinks=True))
    for name in (*READ_ONLY, *(f"tests/{name}" for name in SOURCES)):
        (folder / name).symlink_to(CHECKOUT / name)
    author = ("-c", "user.name=reader", "-c", "user.email=reader@localhost")
    for words in (["init", "-q"], ["add", "dg_specs"], [*author, "commit", "-qm", "specs"]):
        subprocess.run(["git", *words], cwd=folder, check=True)
    return folder


@pytest.mark.parametrize("document", [one for one in DOCUMENTS if any(command_lines(one))], ids=str)
def test_every_command_line_runs(document: Path, workspace: Path) -> None:
    lines = [(line, line.rule) for line in command_lines(document)]
    here = [(line, rule) for line, rule in lines if rule and rule.how in (How.RUN, How.HARDWARE)]
    first = {line.text.split()[0]: line for line, _ in reversed(here)}.values() if document == README else ()
    outcomes = [
        tried(line, rule, workspace, in_a_shell=IS_WHOLE or line in first)
        for line, rule in here
        if IS_WHOLE or not rule.is_long
    ]
    assert [failure for failure in outcomes if failure is not None] == []


def makers(line: CommandLine) -> list[CommandLine]:
    """The lines of its document before it that write what it reads."""
    before = takewhile(lambda other: other != line, command_lines(Path(line.place.rpartition(":")[0])))
    named = set(shlex.split(line.text, comments=True))
    runs = [other for other in before if other.rule is not None and other.rule.how is How.RUN]
    return [other for other in runs if named.intersection(WRITTEN.findall(other.text))]


LONGER = [line for line in all_lines() if line.rule is not None and line.rule.how is How.LIVE]


@pytest.mark.live
@pytest.mark.parametrize(
    "line",
    mostly_soak(LONGER, [line for line in LONGER if line.rule is not None and not line.rule.is_long]),
    ids=lambda line: f"{line.place} {line.text}",
)
def test_every_command_line_that_takes_longer_runs(line: CommandLine, workspace: Path) -> None:
    assert line.rule is not None
    if line.rule.in_checkout and subprocess.run(["make", "-q", ".venv/ready-to-run"], check=False).returncode != 0:
        pytest.skip("this checkout's .venv was not made by make: make would install into it first")
    for maker in makers(line):
        assert maker.rule is not None
        assert tried(maker, maker.rule, workspace) is None
    assert tried(line, line.rule, workspace) is None


def main_of(program: str) -> Callable[[], object] | None:
    """What a program of ours calls, or None if it is no Python of ours."""
    name, *words = program.split()
    if words[:1] == ["-m"]:
        found = find_spec(words[1])
        is_package = found is not None and found.submodule_search_locations is not None
        main: Callable[[], object] = import_module(f"{words[1]}.__main__" if is_package else words[1]).main
        return main
    return OWN_PROGRAMS.get(name)


@cache
def help_of(program: str) -> str:
    """The `--help` of a program. Programs of this project run in this process: another one would import for a
    second."""
    if main_of(program) is None:
        ended = typed(f"make -n {program[5:]}" if program.startswith("make ") else f"{program} --help", CHECKOUT)
        assert ended.returncode == 0, f"`{program}`: {ended.stderr}"
        return ended.stdout
    ended = called(f"{program} --help", CHECKOUT)
    assert ended is not None
    assert ended.returncode == 0, f"`{program} --help` ended with {ended.returncode}"
    return ended.stdout


@pytest.mark.parametrize(("document", "program", "rest"), mentions())
def test_what_the_text_mentions_exists(document: str, program: str, rest: str) -> None:
    options = [word for word in shlex.split(rest) if re.match("--?[a-z]", word)]
    said = help_of(program)
    assert [o for o in options if not re.search(rf"(?<![\w-]){o}(?![\w-])", said)] == []


def test_every_command_line_is_known() -> None:
    lines = all_lines()
    assert [f"{line.place}: add a rule for `{line.text}`" for line in lines if line.rule is None] == []
    assert any(line.text == "make demo" for line in lines), "README.md begins with it"


def test_what_is_not_run_says_why() -> None:
    assert [rule for rule in RULES if rule.how in (How.EXEMPT, How.HARDWARE) and not rule.reason] == []


def test_examples_in_python_run(workspace: Path) -> None:
    for document in DOCUMENTS:
        for language, block in FENCE.findall(document.read_text()):
            if language == "python":
                ended = subprocess.run(
                    [sys.executable, "-W", "error", "-c", block],
                    cwd=workspace,
                    capture_output=True,
                    text=True,
                    check=False,
                )
                assert ended.returncode == 0, f"{document}: {ended.stderr}"


@pytest.mark.parametrize(
    "document", [*DOCUMENTS, *map(Path, ("ARCHITECTURE.md", "CHANGELOG.md", "SECURITY.md"))], ids=str
)
def test_every_link_leads_somewhere(document: Path) -> None:
    links = LINK.findall(document.read_text())
    assert [link for link in links if not (document.parent / link).exists()] == []


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        (
            "```sh\nheronry plan x  # why\n\n# no\nheronry dbc \\\n  x\n```\n",
            ["heronry plan x  # why", "heronry dbc    x"],
        ),
        ("```console\n$ heronry dbc x\noutput\n```\n", ["heronry dbc x"]),
        ("```yaml\nheronry: 1\n```\n", []),
        ("See `heronry dbc x`.\n```text\nheronry dbc x\n```\n", []),
    ],
)
def test_command_lines_are_found_where_readers_see_them(text: str, lines: list[str], tmp_path: Path) -> None:
    document = tmp_path / "some.md"
    document.write_text(text)
    assert [line.text for line in command_lines(document)] == lines


in_both_ways = pytest.mark.parametrize("in_a_shell", [True, False], ids=["in a shell", "called"])


@pytest.mark.parametrize(
    "text",
    [
        "heronry plan big_blu",
        "heronry plan big_blue --dwon pe:nav",
        "heronry verify big_blue missing.json",
        "heronry manager big_blue -c can0 --no-such-flag",
        "pe-agent --table missing.table -i socketcan -c can0",
    ],
)
@in_both_ways
def test_a_command_line_that_cannot_run_is_found_out(text: str, tmp_path: Path, *, in_a_shell: bool) -> None:
    assert outcome(text, tmp_path, in_a_shell=in_a_shell) is not None


@pytest.mark.parametrize(
    "text",
    [
        "heronry plan big_blue --json >plan.json  # not a word of it on the screen",
        "heronry manager big_blue -i socketcan -c can0",
        "heronry table elevator_and_chute tail_pe -o t && pe-agent --table t --simulated -i socketcan -c can0",
    ],
)
@in_both_ways
def test_a_command_line_that_can_run_is_let_pass(text: str, tmp_path: Path, *, in_a_shell: bool) -> None:
    assert outcome(text, tmp_path, in_a_shell=in_a_shell) is None


def outcome(text: str, folder: Path, *, in_a_shell: bool) -> str | None:
    (folder / "some.md").write_text(f"```sh\n{text}\n```\n")
    (line,) = command_lines(folder / "some.md")
    assert line.rule is not None
    return tried(line, line.rule, folder, in_a_shell=in_a_shell)


def test_readme_leaves_no_untracked_file() -> None:
    """What the README's commands write at the top of a checkout is ignored by git."""
    lines = list(command_lines(Path("README.md")))
    written = [name for line in lines for name in re.findall(r"(?:-o |--record |>\s?)(\S+)", line.text)]
    assert len(written) >= 5
    ended = subprocess.run(
        ["git", "check-ignore", "--no-index", *written], cwd=CHECKOUT, capture_output=True, text=True, check=False
    )
    assert ended.stdout.split() == written


def test_no_document_installs_heronry_from_where_it_is_not() -> None:
    """It is on no package index: git, a checkout, a wheel or a wheelhouse has it."""
    commands = [
        (document, command)
        for document in DOCUMENTS
        for command in re.findall(r"pip install ([^`\n]*heronry\[[^`\n]*)", document.read_text())
    ]
    assert commands
    assert [one for one in commands if not re.search(r"heronry\[\w+\] @ git\+|^--no-index -f ", one[1])] == []
    assert any("\npip wheel --no-deps" in document.read_text() for document in DOCUMENTS), "how to build the wheel"


def test_the_table_of_extras_has_every_extra_that_a_user_may_add() -> None:
    extras = tomllib.loads(Path("pyproject.toml").read_text())["project"]["optional-dependencies"]
    rows = re.findall(r"^\| `(\w+)` \| ", Path("docs/command_line.md").read_text(), re.MULTILINE)
    assert set(rows) == extras.keys() - {"dev", "fuzz"}


def test_the_revision_of_the_hook_exists() -> None:
    (revision,) = re.findall(r"^ +rev: (\S+)$", Path("docs/check.md").read_text(), re.MULTILINE)
    git = partial(subprocess.run, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    if git(["git", "rev-parse", "--is-shallow-repository"]).stdout.strip() != "false":
        pytest.skip("this checkout has not the whole history")
    shown = git(["git", "show", f"{revision}:.pre-commit-hooks.yaml"])
    assert "id: heronry-check" in shown.stdout, shown.stderr
