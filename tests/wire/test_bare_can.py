"""python-can is imported without what it does not need, and all of it can be used afterwards."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import heronry_agent
import heronry_dg
import heronry_manager
import heronry_tools
import heronry_wire
from heronry_wire.bare_can import _Later

PACKAGES = (heronry_wire, heronry_dg, heronry_agent, heronry_manager, heronry_tools)


def printed(program: str) -> str:
    return subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.strip()


def test_asammdf_is_not_imported_and_can_be() -> None:
    program = "import sys, heronry_wire.link; print('asammdf' in sys.modules); import asammdf; print(asammdf.__name__)"
    assert printed(program) == "False\nasammdf"


def test_asyncio_is_imported_when_python_can_asks_for_it() -> None:
    program = """
import sys
from heronry_wire.bare_can import can
print("asyncio" in sys.modules, "ssl" in sys.modules)
can.AsyncBufferedReader()
import asyncio
print(can.notifier.asyncio.iscoroutine is asyncio.iscoroutine)
"""
    assert printed(program) == "False False\nTrue"


def test_a_log_in_a_data_base_is_written_and_read(tmp_path: Path) -> None:
    program = f"""
import sys
from heronry_wire.bare_can import can
print("sqlite3" in sys.modules, "wrapt" in sys.modules)
with can.SqliteWriter({str(tmp_path / "log.db")!r}) as log:
    log(can.Message(arbitration_id=5, data=[1, 2]))
print([one.arbitration_id for one in can.SqliteReader({str(tmp_path / "log.db")!r})])
"""
    assert printed(program) == "False False\n[5]"


def test_a_stand_in_makes_way_for_what_is_asked_during_the_import(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = _Later("colorsys")
    monkeypatch.setitem(sys.modules, "colorsys", stand_in)
    assert stand_in.rgb_to_hsv(0, 0, 0) == (0.0, 0.0, 0)
    assert sys.modules["colorsys"] is not stand_in


def test_a_program_that_has_python_can_keeps_it() -> None:
    program = "import can, sys, heronry_wire.bare_can as bare; print(bare.can is can, 'asammdf' in sys.modules)"
    assert printed(program) == "True True"


def test_no_other_file_imports_python_can_itself() -> None:
    found = []
    for package in PACKAGES:
        for file in Path(package.__path__[0]).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
                if any(name.split(".")[0] == "can" for name in names):
                    found.append(file.name)
    assert sorted(set(found)) == ["bare_can.py"]
