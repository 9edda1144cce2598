"""Arguments of `pe-agent`, and its messages."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from agent.one_pe import GATEWAY_TABLE, TABLE
from heronry_agent.core.vocabulary import Note
from heronry_agent.shell import cli
from heronry_agent.shell.cli import main
from heronry_wire.protocol_version import PROTOCOL, Version


@pytest.fixture
def table(tmp_path: Path) -> str:
    file = tmp_path / "tail.table"
    file.write_text(TABLE.to_json())
    return str(file)


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code and the one sentence on standard error."""
    code = main(arguments)
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    return code, line


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--bus", "radio=socketcan:can1"], "tail has no such bus; it has can0"),
        (["--bus", "can0"], "write it as NAME=[INTERFACE:]CHANNEL, such as can0=socketcan:can0"),
        (["--bus", "can0=x", "--bus", "can0=y"], "--bus can0 is given twice"),
    ],
)
def test_a_bus_that_cannot_be_meant(
    capsys: pytest.CaptureFixture[str], table: str, arguments: list[str], says: str
) -> None:
    code, line = complaint(capsys, "--table", table, *arguments)
    assert code == 2
    assert says in line


@pytest.mark.parametrize("text", ["dg: 1\nbuses: {}\n", "# an aircraft\n\ndg: 1\n"])
def test_a_spec_in_the_place_of_a_table_is_to_be_compiled_first(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str
) -> None:
    file = tmp_path / "wing.dg.yaml"
    file.write_text(text)
    code, line = complaint(capsys, "--table", str(file), "-i", "softbus", "-c", "/no/such.sock")
    assert code == 2
    assert line == (
        f"pe-agent: {file}: the text is a spec, not a table; compile the spec first, on a computer with the manager: "
        "heronry table SPEC PE -o PE.table"
    )


def test_a_gateway_needs_every_bus_by_name(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "link.table"
    file.write_text(GATEWAY_TABLE.to_json())
    code, line = complaint(capsys, "--table", str(file), "-i", "socketcan", "-c", "can0")
    assert code == 2
    assert "add --bus radio=INTERFACE:CHANNEL" in line


def test_a_device_driver_that_is_not_there_is_told_before_the_bus_is_touched(
    capsys: pytest.CaptureFixture[str], table: str
) -> None:
    code, line = complaint(capsys, "--table", table, "--simulated", "absent", "-i", "softbus", "-c", "/no/such.sock")
    assert (code, line) == (2, "pe-agent: no device driver is named 'absent'; installed are: flight, plant")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "No such file"),
        (b"\xff\xfe", "the file is not text"),
        (b"{", "not JSON"),
        (b"[]", "not a JSON object"),
        (TABLE.to_json().replace('"node_id":93', '"node_id":3').encode(), "is damaged"),
        (replace(TABLE, node_id=3).to_json().encode(), "node_id 3"),
        (
            replace(TABLE, protocol=Version(2, 0)).to_json().encode(),
            f"of protocol 2.0, and this agent speaks {PROTOCOL}",
        ),
    ],
)
def test_a_table_that_cannot_be_used(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, content: bytes | None, says: str
) -> None:
    file = tmp_path / "some.table"
    if content is not None:
        file.write_bytes(content)
    code, line = complaint(capsys, "--table", str(file), "-c", "x")
    assert code == 2
    assert says in line
    assert str(file) in line
    assert "heronry table" in line


def test_a_table_without_an_end_is_no_table(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert complaint(capsys, "--table", "/dev/zero", "-c", "x") == (
        2,
        "pe-agent: /dev/zero: this is not an ordinary file; write the table with 'heronry table'",
    )
    file = tmp_path / "long.table"
    with file.open("wb") as long:
        long.truncate(1 << 40)
    code, line = complaint(capsys, "--table", str(file), "-c", "x")
    assert (code, line) == (2, f"pe-agent: {file} is longer than any table; write the table with 'heronry table'")


def test_a_bus_that_is_not_there(capsys: pytest.CaptureFixture[str], table: str, tmp_path: Path) -> None:
    code, line = complaint(
        capsys, "--table", table, "--simulated", "-q", "--bus", f"can0=softbus:{tmp_path / 'none.sock'}"
    )
    assert code == 2
    assert "no bus answers there" in line


def test_each_line_of_an_agent_begins_with_the_time_of_day_as_those_of_all_programs_do(
    capsys: pytest.CaptureFixture[str],
) -> None:
    cli._print_note(Note("late", "this computer stood still for 140 ms"))
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} late: this computer stood still for 140 ms\n", capsys.readouterr().err)


def test_the_small_install_is_enough() -> None:
    heavy = "yaml pydantic ortools numpy rich cantools heronry_dg heronry_manager"
    program = f"import heronry_agent.shell.cli, sys; print(*(set({heavy!r}.split()) & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []
