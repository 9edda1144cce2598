"""The compiled simulator: another folder, the same frames."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import heronry_wire
from heronry_tools.console.errors import UserError
from heronry_tools.sim.compiled import machine_code as compiled
from heronry_tools.sim.compiled.machine_code import (
    compile_into,
    compiled_folder,
    environment,
    go_on_compiled,
    make,
    sources,
)
from heronry_tools.sim.world import clock

SMALL = (Path("heronry_wire/layout.py"), Path("heronry_tools/sim/world/local_clock.py"))
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "heronry" / "compiled"


def told(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """What Python prints with the packages of a folder."""
    env = environment(folder)
    return subprocess.run([sys.executable, "-P", *words], env=env, capture_output=True, text=True, check=False)


def test_every_file_that_is_compiled_is_there() -> None:
    roots = {package.__name__: Path(package.__path__[0]) for package in compiled._PACKAGES}
    assert [file for file in sources() if not (roots[file.parts[0]].parent / file).is_file()] == []


def test_every_shipped_spec_is_in_the_copy() -> None:
    specs = {name for name, _ in compiled._copied() if name.endswith(".dg.yaml")}
    assert {"heronry_dg/specs/big_blue.dg.yaml", "heronry_dg/specs/flights/eav.dg.yaml"} <= specs


def test_every_class_with_a_compiled_base_is_compiled() -> None:
    """A class of Python cannot inherit from a native class that does not allow it: it fails when it is used."""
    native = {str(file) for file in sources()}
    found = []
    for name, file in compiled._copied():
        text = file.read_text() if name.endswith(".py") and name not in native else ""
        based = re.findall(r"^class (\w+)\((\w+)", text, re.MULTILINE)
        origin = {
            one.asname or one.name: str(node.module).replace(".", "/") + ".py"
            for node in (ast.parse(text).body if based else ())
            if isinstance(node, ast.ImportFrom)
            for one in node.names
        }
        allowed = compiled._DERIVED_FROM
        found += [(name, own) for own, base in based if base not in allowed and origin.get(base) in native]
    assert found == []


def test_arguments_by_name_without_a_default_come_first_since_mypyc_may_write_no_other_signature() -> None:
    roots = {package.__name__: Path(package.__path__[0]) for package in compiled._PACKAGES}
    for file in sources():
        tree = ast.parse((roots[file.parts[0]].parent / file).read_text())
        for function in ast.walk(tree):
            if isinstance(function, ast.FunctionDef):
                has_default = [one is not None for one in function.args.kw_defaults]
                assert has_default == sorted(has_default), f"{file}: {function.name}"


@needs_compiler
def test_a_compiled_part_is_taken_from_the_folder_beside_python(tmp_path: Path) -> None:
    compile_into(tmp_path / "new", SMALL)
    script = "import heronry_tools.sim.world.local_clock as clock; print(clock.__file__)"
    file = Path(told(tmp_path / "new", "-c", script).stdout.strip())
    assert file.parent == tmp_path / "new" / "heronry_tools" / "sim" / "world"
    assert file.suffix == ".so"
    assert not (tmp_path / "new" / "build").exists()


@needs_compiler
@pytest.mark.soak  # everything is compiled: two minutes
def test_a_flight_in_machine_code_has_the_same_frames() -> None:
    flight = ("-m", "heronry_tools", "sim", "elevator_and_chute", "--seed", "3", "--seconds", "3", "--json")
    python, compiled = (flown([*flight, *more]) for more in ((), ("--compiled",)))
    assert digests(python) == digests(compiled) != []


def flown(words: list[str]) -> str:
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def digests(told: str) -> list[str]:
    return [flight["digest"] for flight in map(json.loads, told.splitlines()) if "digest" in flight]


@needs_compiler
def test_what_cannot_be_compiled_says_why(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"compiling failed(?s:.*)no_such_file"):
        compile_into(tmp_path / "new", [Path("heronry_wire/no_such_file.py")])


def test_without_a_compiler_it_says_what_to_install(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    with pytest.raises(UserError, match="the C compiler no-such-compiler is not found: install one"):
        make(compiled_folder())
    assert [file.name for file in cache.iterdir()] == ["lock"]


def test_sources_that_change_are_another_folder(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "heronry_wire"
    package.mkdir()
    monkeypatch.setattr(heronry_wire, "__path__", [str(package)])
    folders = []
    for text in ("one", "two", "one"):
        (package / "some.py").write_text(text)
        folders.append(compiled_folder())
    assert folders[0] == folders[2] != folders[1]
    assert {folder.parent for folder in folders} == {cache}


def test_a_cache_that_cannot_be_written_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(UserError, match=r"cannot be written .*: set XDG_CACHE_HOME"):
        make(compiled_folder())


def test_a_folder_that_does_not_come_first_is_reported_and_not_tried_again(cache: Path) -> None:
    folder = compiled_folder()
    folder.mkdir(parents=True)  # holds nothing, so Python finds other sources
    done = told(folder, "-m", "heronry_tools", "sim", "elevator_and_chute", "--compiled")
    assert done.returncode == 2
    assert f"Python finds other sources of heronry before those in {folder}" in done.stderr


def test_a_process_goes_on_in_the_folder_that_is_there(cache: Path) -> None:
    compiled_folder().mkdir(parents=True)
    done = subprocess.run(
        [sys.executable, "-m", "heronry_tools", "exhaust", "big_blue", "--compiled"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Python finds other sources of heronry before" in done.stderr


def test_a_copy_that_was_not_used_for_long_is_deleted(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, age_s in (("used", 0), ("forgotten", 90 * 86_400)):
        (cache / name).mkdir(parents=True)
        os.utime(cache / name, (1_000_000_000 - age_s, 1_000_000_000 - age_s))
    compiled.forget_old(cache, 1_000_000_000 + 86_400)
    assert [folder.name for folder in cache.iterdir()] == ["used"]


def test_go_on_compiled_does_nothing_in_a_compiled_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "__file__", "clock.so")
    go_on_compiled(("sim",))
