"""The tutorial works as it is written: its blocks, put into one file in order, give what it shows after each of them.

A block of YAML adds to the file as a reader would: entries go under their heading, and one that is already there is
replaced. Then every command is run on the file as it is by then, and the output compared with what is shown; a line
`...` stands for any lines.
"""

import re
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main

TUTORIAL = Path("docs/tutorial.md")
FILE, CODE = "my.dg.yaml", "my_estimator.py"
BLOCK = re.compile(r"^```(yaml|console|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PROMPT = re.compile(r"^\$ heronry ", re.MULTILINE)
HEADING = re.compile(r"^(?=\w+:)", re.MULTILINE)
ENTRY = re.compile(r"(?:^  #.*\n)*^  \w+:.*\n(?:^    .*\n)*", re.MULTILINE)

Sections = dict[str, dict[str, str]]


def blocks() -> Iterator[tuple[str, str]]:
    for block in BLOCK.finditer(TUTORIAL.read_text()):
        yield block[1], block[2]


def code() -> str:
    """The module that the reader writes."""
    (block,) = re.findall(r"^```python\n(.*?)^```$", TUTORIAL.read_text(), re.MULTILINE | re.DOTALL)
    return str(block)


def shell(block: str) -> None:
    """Type lines of a shell, but for flights, which tests/live/test_demo.py flies."""
    for line in block.splitlines():
        if line.startswith("heronry demo"):
            continue
        if line.startswith("heronry "):
            assert main(shlex.split(line)[1:]) == 0, line
        else:
            subprocess.run(line, shell=True, check=True)


def add(block: str, sections: Sections) -> None:
    """Put a block's entries where they belong; a heading with its value on the same line is one entry."""
    for part in filter(None, HEADING.split(block)):
        first, _, body = part.partition("\n")
        heading, _, value = first.partition(":")
        entries = ENTRY.findall(body)
        assert "".join(entries) == body, f"not read: {body}"
        section = sections.setdefault(heading, {})
        section.update({"": value} if value else {_name(entry): entry for entry in entries})


def _name(entry: str) -> str:
    (name,) = re.findall(r"^  (\w+):", entry, re.MULTILINE)
    return str(name)


def text_of(sections: Sections) -> str:
    return "".join(
        f"{heading}:{entries.get('', '')}\n" + "".join(entry for name, entry in entries.items() if name)
        for heading, entries in sections.items()
    )


def same(shown: str, output: str) -> bool:
    lines = [r"(?:.*\n)*?" if line == "..." else re.escape(line + "\n") for line in shown.rstrip("\n").split("\n")]
    return re.fullmatch("".join(lines), output.rstrip("\n") + "\n") is not None


@pytest.fixture
def plain_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    monkeypatch.setenv("COLUMNS", "120")


def test_every_command_shows_what_the_tutorial_shows(
    capsys: pytest.CaptureFixture[str], plain_shell: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, own = [*blocks()], code()
    monkeypatch.chdir(tmp_path)
    Path(CODE).write_text(own)
    sections: Sections = {}
    commands = 0
    for language, block in read:
        if language == "yaml":
            add(block, sections)
            Path(FILE).write_text(text_of(sections))
            load(FILE)
            continue
        if language == "sh":
            shell(block)
            continue
        for said in PROMPT.split(block)[1:]:
            command, _, shown = said.partition("\n")
            assert FILE in command or CODE.removesuffix(".py") in command
            assert main(shlex.split(command)) == 0, command
            output = capsys.readouterr().out
            assert same(shown, output), f"{command} shows\n{output}"
            commands += 1
    assert commands >= 5


def test_what_the_reader_has_written_is_the_shipped_spec() -> None:
    sections: Sections = {}
    for language, block in blocks():
        if language == "yaml":
            add(block, sections)
    mine, shipped = loads(text_of(sections), FILE), load(shipped_spec_path("elevator_and_chute"))
    assert replace(mine, digest="") == replace(shipped, digest="")


def test_the_tutorial_names_every_example() -> None:
    text = TUTORIAL.read_text()
    for file in Path("dg_specs/examples").iterdir():
        lesson = file.read_text().splitlines()[1].removeprefix("# ")
        assert f"| [{file.name.removesuffix('.dg.yaml')}](../{file}) | {lesson} |" in text


@pytest.mark.parametrize(
    ("shown", "output", "agrees"),
    [
        ("a\nb", "a\nb\n", True),
        ("a\n...\nb", "a\nx\ny\nb\n", True),
        ("a\n...", "a\nx\ny\n", True),
        ("a\n...\nb", "a\nx\n", False),
        ("a.c", "abc\n", False),
    ],
)
def test_what_is_left_out_is_marked(shown: str, output: str, agrees: bool) -> None:
    assert same(shown, output) is agrees
