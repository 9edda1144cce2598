"""What is installed where: a node without the manager's packages, and a wheel that needs no checkout."""

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from email.parser import Parser
from pathlib import Path

import can
import pytest

from heronry_dg.loader import load
from heronry_manager.events import PlanReady
from heronry_manager.events.reading import events_in
from heronry_tools.command_table import COMMANDS, HELP
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.identifiers import state_id
from heronry_wire.pe_table import PeTable

pytestmark = pytest.mark.live
on_the_wheel = pytest.mark.xdist_group("wheel")  # it is built once

ROOT = Path(__file__).resolve().parents[2]
SPEC_FILE = ROOT / "dg_specs" / "elevator_and_chute.dg.yaml"
PATIENCE_S = 30.0
AGENT_KIB = 33 * 1024  # python-can alone takes 25 MiB
_SHORT = ("--kill", "pe:tail_pe@1", "--for", "4", "--json")
EXTRAS = ("cantools", "canopen", "numpy", "ortools", "pydantic", "rich", "yaml")
EXTRAS += ("asammdf", "mcap", "prometheus_client", "starlette", "textual", "uvicorn")

# Python imports `sitecustomize` at its start: from then on what these name cannot be imported.
_WITHOUT = """\
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {modules!r} or name in {rooms!r}:
            raise ModuleNotFoundError("No module named " + repr(name), name=name)
sys.meta_path.insert(0, Blocker())
"""
_ALL_HELP = """\
import sys
from heronry_tools.cli import main
for name in sys.argv[1:]:
    print()
    try:
        main([name, "--help"])
    except SystemExit as ended:
        assert ended.code == 0, (name, ended.code)
"""
_CODES = """\
import sys
from heronry_tools.cli import main
for words in sys.argv[1:]:
    print(main(words.split()), flush=True)
"""
_WITHOUT_CHECKOUT = """\
import glob, sys
own = {folder!r}
sys.path[:] = [found for found in sys.path if found == own or not glob.glob(found + "/heronry_*/__init__.py")]
"""


def environment(folder: Path, customization: str, *found_first: str) -> dict[str, str]:
    """Environment of a Python that starts with a customization of its own, and looks into these folders first."""
    (folder / "sitecustomize.py").write_text(customization)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *found_first])}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Where `pip install heronry` has installed no extra."""
    folder, own = tmp_path_factory.mktemp("small"), os.environ.get("PYTHONPATH", "")
    small = environment(folder, _WITHOUT.format(modules=EXTRAS, rooms=()), own)
    assert "No module named 'pydantic'" in run("-c", "import pydantic", env=small).stderr
    return small


def run(*arguments: str, env: dict[str, str] | None = None, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], env=env, cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


# A node


@contextmanager
def agent_on_a_bus(folder: Path, env: dict[str, str], table: Path) -> Iterator[tuple[str, int]]:
    """An agent that has been heard for a second of its heartbeats: its bus, its process; it ends in order."""
    with (
        start_hub(folder / "can0.sock") as hub,
        can.Bus(interface="softbus", channel=str(hub.path)) as bus,
        subprocess.Popen(
            [
                *(sys.executable, "-m", "heronry_agent", "--table", str(table), "--simulated"),
                *("-i", "softbus", "-c", str(hub.path)),
            ],
            env=env,
            stderr=subprocess.PIPE,
            text=True,
        ) as agent,
    ):
        heard = 0
        while heard < 50:
            message = bus.recv(PATIENCE_S)
            assert message is not None, "the agent is silent"
            heard += message.arbitration_id == state_id(94)
        try:
            yield str(hub.path), agent.pid
        finally:
            agent.terminate()
            _, said = agent.communicate(timeout=PATIENCE_S)
        assert agent.returncode == 0
    assert "Traceback" not in said
    assert "cannot be run here" not in said  # every image of the spec can be loaded


def test_an_agent_flies_on_a_small_install(small: dict[str, str], tmp_path: Path) -> None:
    table = write_tables(load(SPEC_FILE), ("tail_pe",), tmp_path)["tail_pe"]
    with agent_on_a_bus(tmp_path, small, table) as (_, pid):
        resident = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
        assert resident is not None
        assert int(resident[1]) <= AGENT_KIB


def test_an_agent_without_devices_and_with_images_of_its_own_loads_no_simulation(tmp_path: Path) -> None:
    """All but the software bus, which is how it is heard here: no plant, no shipped image, no manager, no graph."""
    table = PeTable.from_json(write_tables(load(SPEC_FILE), ("tail_pe",), tmp_path)["tail_pe"].read_text())
    own = tuple(replace(module, device=None, image="agent.modules_for_host:Steady") for module in table.modules)
    (tmp_path / "own.table").write_text(replace(table, modules=own).to_json())
    modules = (*EXTRAS, "heronry_dg", "heronry_manager")
    rooms = (
        "heronry_tools.aircraft",
        "heronry_tools.sim",
        "heronry_tools.analysis",
        "heronry_tools.commands",
        "heronry_tools.command_lines",
    )
    found_first = (str(ROOT / "tests"), os.environ.get("PYTHONPATH", ""))
    bare = environment(tmp_path, _WITHOUT.format(modules=modules, rooms=rooms), *found_first)
    with agent_on_a_bus(tmp_path, bare, tmp_path / "own.table"):
        pass


def test_the_doctor_of_a_small_install_says_what_it_cannot_ask(small: dict[str, str], tmp_path: Path) -> None:
    table = write_tables(load(SPEC_FILE), ("tail_pe",), tmp_path)["tail_pe"]
    with agent_on_a_bus(tmp_path, small, table) as (bus, _):
        done = run("-m", "heronry_tools", "doctor", "-i", "softbus", "-c", bus, "--seconds", "1", "--json", env=small)
    assert (done.returncode, done.stderr) == (1, "")
    told = {one["check"]: one for one in json.loads(done.stdout)["findings"]}
    assert told["versions"]["ok"]
    assert told["tables"] == {
        "check": "tables",
        "ok": False,
        "says": "the specs of the PEs are unknown: canopen is not installed",
        "type": 'pip install "heronry[doctor]"',
    }


def test_send_table_says_before_it_plans_that_it_needs_canopen(tmp_path: Path) -> None:
    without = environment(tmp_path, _WITHOUT.format(modules=("canopen",), rooms=()), os.environ.get("PYTHONPATH", ""))
    done = run(
        *("-m", "heronry_tools", "send-table", "big_blue", "nav", "-i", "softbus", "-c", "/no/such.sock"),
        env=without,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == 'heronry: canopen is not installed; add it with: pip install "heronry[manager]"\n'


def test_the_doctor_looks_at_a_small_install(small: dict[str, str], tmp_path: Path) -> None:
    """With a table for what should be there: a spec needs more than a node has."""
    table = write_tables(load(SPEC_FILE), ("tail_pe",), tmp_path)["tail_pe"]
    with start_hub(tmp_path / "can0.sock") as hub:
        words = ["doctor", str(table), "-i", "softbus", "-c", str(hub.path), "--seconds", "0.1", "--json"]
        done = run("-m", "heronry_tools", *words, env=small)
    assert (done.returncode, done.stderr) == (1, "")  # no other node is there
    assert {"versions", "bus", "manager", "nodes"} <= {one["check"] for one in json.loads(done.stdout)["findings"]}


@pytest.mark.parametrize("module", ["heronry_agent", "heronry_tools"])
def test_help_needs_no_extra(small: dict[str, str], module: str) -> None:
    done = run("-m", module, "--help", env=small)
    assert (done.returncode, done.stderr) == (0, "")
    assert "usage: " in done.stdout


def test_the_help_of_every_command_needs_no_extra(small: dict[str, str]) -> None:
    """All in one process: what cannot be imported there cannot be for any of them."""
    commands = sorted(COMMANDS.keys() - {HELP})
    done = run("-c", _ALL_HELP, *commands, env=small)
    assert (done.returncode, done.stderr) == (0, "")
    assert [done.stdout.count(f"\nusage: heronry {name}") for name in commands] == [1] * len(commands)


NEED_THE_MANAGER = (
    "demo",
    "diff big_blue elevator_and_chute",
    "manager big_blue -i softbus -c /no/such.sock",
    "plan big_blue",
    "render big_blue",
    "sim big_blue",
    "table big_blue nav",
    "verify big_blue plan.json",
)


def test_what_needs_the_manager_says_how_to_get_it(small: dict[str, str]) -> None:
    """One command in a process of its own; all of them in one other process, since none can be imported there."""
    alone = run("-m", "heronry_tools", *NEED_THE_MANAGER[0].split(), env=small)
    done = run("-c", _CODES, *NEED_THE_MANAGER, env=small)
    assert (alone.returncode, alone.stdout) == (2, "")
    assert done.stdout.split() == ["2"] * len(NEED_THE_MANAGER), done.stderr
    for sentence in [alone.stderr.rstrip("\n"), *done.stderr.splitlines()]:
        assert sentence.startswith("heronry: ")
        assert sentence.endswith(' is not installed; add it with: pip install "heronry[manager]"')
    assert done.stderr.count("\n") == len(NEED_THE_MANAGER)


def test_a_manager_without_its_solver_says_so_and_goes_on(tmp_path: Path) -> None:
    """It has what `heronry check --fast` needs; here it gets as far as to its bus."""
    without = environment(tmp_path, _WITHOUT.format(modules=("ortools",), rooms=()), os.environ.get("PYTHONPATH", ""))
    done = run("-m", "heronry_tools", "manager", "big_blue", "-i", "softbus", "-c", "/no/such.sock", env=without)
    said, failed = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, "")
    assert said == (
        "heronry: ortools is not installed, so only the greedy planner is used; "
        'add it with: pip install "heronry[manager]"'
    )
    assert "/no/such.sock" in failed


@pytest.mark.soak  # test_a_manager_without_its_solver has its start in every run, test_immediate_plans.py its plans
def test_a_demo_flies_and_reconfigures_without_a_solver(tmp_path: Path) -> None:
    without = environment(tmp_path, _WITHOUT.format(modules=("ortools",), rooms=()), os.environ.get("PYTHONPATH", ""))
    done = run("-m", "heronry_tools", "demo", "elevator_and_chute", *_SHORT, env=without)
    assert done.returncode == 0, done.stderr
    events = list(events_in(done.stdout.splitlines()))
    plans = [event.plan for event in events if isinstance(event, PlanReady)]
    assert [event.kind for event in events].count("reconfigured") >= 2
    assert {plan.optimal for plan in plans} == {False}
    assert plans[0].functions["elevator"].served


MODULES = {
    "prometheus-client": "prometheus_client",
    "pyyaml": "yaml",
}  # package -> what it is imported as, where that is another name


def modules_of(extra: str) -> set[str]:
    """What `pip install heronry[EXTRA]` brings, of what extras bring."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    found: set[str] = set()
    for requirement in extras[extra]:
        named = re.fullmatch(r"([\w.-]+)(?:\[([\w,]+)\])?.*", requirement)
        assert named is not None
        package, inner = named.groups()
        if package == "heronry":
            found.update(*(modules_of(one) for one in inner.split(",")))
        else:
            found.add(MODULES.get(package, package))
    return found


@pytest.mark.parametrize(
    ("extra", "words", "code"),
    [
        ("check", ["check", "--fast", "elevator_and_chute"], 0),
        ("check", ["plan", "elevator_and_chute", "--planner", "greedy"], 0),
        ("doctor", ["doctor", "elevator_and_chute", "-i", "softbus", "-c", "/no/such.sock", "--seconds", "0.1"], 1),
        ("watch", ["dbc", "elevator_and_chute"], 0),
        ("watch", ["top", "--schema"], 0),
        ("web", ["web", "--of", "nosuch"], 2),
        ("manager", ["plan", "elevator_and_chute"], 0),
        ("manager", ["doctor", "elevator_and_chute", "-i", "softbus", "-c", "/no/such.sock", "--seconds", "0.1"], 1),
        ("cluster", ["contingencies", "elevator_and_chute", "--faults", "0", "--jobs", "1", "-o", "made"], 0),
    ],
)
def test_an_extra_installs_what_its_documentation_uses(tmp_path: Path, extra: str, words: list[str], code: int) -> None:
    absent = tuple(set(EXTRAS) - modules_of(extra) - ({"numpy"} if "ortools" in modules_of(extra) else set()))
    only = environment(tmp_path, _WITHOUT.format(modules=absent, rooms=()), str(ROOT), os.environ.get("PYTHONPATH", ""))
    done = run("-m", "heronry_tools.cli", *words, env=only, cwd=tmp_path)
    assert "not installed" not in done.stdout + done.stderr
    assert done.returncode == code, done.stderr


def test_what_needs_the_watch_extra_says_how_to_get_it(small: dict[str, str]) -> None:
    done = run("-m", "heronry_tools", "dbc", env=small)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == 'heronry: yaml is not installed; add it with: pip install "heronry[watch]"\n'


# The wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    done = run("-m", "hatchling", "build", "-t", "wheel", "-d", str(folder))
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("heronry-*.whl")
    return built


@on_the_wheel
def test_the_wheel_holds_the_product_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        entry_points = next(archive.read(name).decode() for name in names if name.endswith("entry_points.txt"))
        metadata = next(archive.read(name).decode() for name in names if name.endswith(".dist-info/METADATA"))
    rooms = {"heronry_wire", "heronry_dg", "heronry_pcs", "heronry_agent", "heronry_manager", "heronry_tools"}
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == rooms
    assert {f"{room}/py.typed" for room in rooms} <= names
    assert {"heronry_wire/nod.csv", "heronry_tools/runtime/vcan/xstate.c"} <= names
    assert {f"heronry_tools/runtime/deployment/heronry-{node}@.service" for node in ("agent", "manager")} <= names
    assert {f"heronry_dg/specs/{name}.dg.yaml" for name in ("big_blue", "elevator_and_chute")} <= names
    assert {f"heronry_pcs/graphs/{name}.pcs.yaml" for name in ("g_eav", "g_max", "g_star")} <= names
    assert any(name.endswith("/licenses/LICENSE") for name in names)
    for line in (
        "heronry = heronry_tools.__main__:main",
        "pe-agent = heronry_agent.__main__:main",
        "softbus = heronry_tools.runtime.softbus.client:SoftBus",
    ):
        assert line in entry_points
    needed = [line for line in Parser().parsestr(metadata).get_all("Requires-Dist", []) if "extra ==" not in line]
    assert sorted(line.partition(">")[0] for line in needed) == ["python-can"]


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("installed")
    done = run("-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target", str(folder), str(wheel))
    assert done.returncode == 0, done.stderr
    return folder


@on_the_wheel
def test_an_installed_wheel_works_without_the_checkout(installed: Path, tmp_path: Path) -> None:
    hidden = environment(tmp_path, _WITHOUT_CHECKOUT.format(folder=str(installed)), str(installed))
    find = "from heronry_dg.shipped import shipped_spec_path; print(shipped_spec_path('big_blue'))"
    found = run("-P", "-c", find, env=hidden, cwd=tmp_path)
    assert found.stdout.strip() == str(installed / "heronry_dg" / "specs" / "big_blue.dg.yaml")
    planned = run("-m", "heronry_tools", "plan", "elevator_and_chute", "--json", env=hidden, cwd=tmp_path)
    assert planned.returncode == 0, planned.stderr
    (tmp_path / "plan.json").write_text(planned.stdout)
    assessed = run("-m", "heronry_tools", "verify", "elevator_and_chute", "plan.json", env=hidden, cwd=tmp_path)
    assert (assessed.returncode, assessed.stdout) == (0, "legal: no rule is broken\n")
    cut = run("-m", "heronry_tools.cli", "pcs", "cut", "g_star", env=hidden, cwd=tmp_path)
    assert (cut.returncode, cut.stdout.partition("\n")[0]) == (0, "at least 950 bit/s cross")
    nowhere = environment(tmp_path, _WITHOUT_CHECKOUT.format(folder=""))
    assert "No module named 'heronry_dg" in run("-P", "-c", find, env=nowhere, cwd=tmp_path).stderr
