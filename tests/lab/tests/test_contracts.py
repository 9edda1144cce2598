"""Every contract on imports is effective: a breach of it, planted in a copy of the sources, fails `lint-imports`."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[3]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
FOLDERS = tuple(SETTINGS["hatch"]["build"]["dev-mode-dirs"])
CONTRACTS = {contract["name"]: contract for contract in SETTINGS["importlinter"]["contracts"]}


class Breach(NamedTuple):
    """A folder for a module, and the import that a contract forbids there."""

    room: str
    imported: str


# A file of each room of the cores: others import the room, and no file of it.
INSIDE_A_ROOM_OF_THE_AGENT = {
    "authority": "followed_manager",
    "canopen": "sdo_server",
    "checkpoints": "keeping",
    "configuration": "staging",
    "forwarding": "gateway",
    "modules": "schedule",
    "reports": "faults",
    "table_change": "switching",
}
INSIDE_A_ROOM_OF_THE_MANAGER = {
    "authentication": "authenticity",
    "epochs": "deployment",
    "heartbeat": "beat",
    "intake": "inbound",
    "mastership": "claim",
    "membership": "health",
    "planning": "requests",
    "provisioning": "table_bringing",
    "reloading": "reload",
    "reports": "manager_status",
    "sdo_client": "object_reader",
    "situation": "known_situation",
    "tables": "compilation",
}
BREACHES = {
    **{
        f"The room {room} of the manager's core is entered by its door": Breach(
            "manager/heronry_manager/shell", f"heronry_manager.core.{room}.{file}"
        )
        for room, file in INSIDE_A_ROOM_OF_THE_MANAGER.items()
    },
    **{
        f"The room {room} of the agent's core is entered by its door": Breach(
            "pe_agent/heronry_agent/shell", f"heronry_agent.core.{room}.{file}"
        )
        for room, file in INSIDE_A_ROOM_OF_THE_AGENT.items()
    },
    "Rooms of the agent's core: each imports only what stands below it": Breach(
        "pe_agent/heronry_agent/core/reports", "heronry_agent.core.modules"
    ),
    "Rooms of the manager's core: each imports only what stands below it": Breach(
        "manager/heronry_manager/core/membership", "heronry_manager.core.epochs"
    ),
    (
        "Packages: tools above manager and agent, those above component graphs, then dependency graphs, then the wire"
    ): Breach("dg_specs/heronry_dg", "heronry_pcs.graph"),
    "The agent, and so pe-agent, imports the wire alone: nothing above the agent, and no dependency graph": Breach(
        "pe_agent/heronry_agent/shell", "heronry_dg.model"
    ),
    "What plans and what flies knows no component graph": Breach("manager/heronry_manager/core", "heronry_pcs.graph"),
    "A PE needs python-can alone": Breach("pe_agent/heronry_agent/shell", "canopen"),
    "Only drivers of real devices need their libraries": Breach("pe_agent/heronry_agent/shell", "serial"),
    "Packages of the tools, from the command line down to the console": Breach(
        "tools/heronry_tools/console", "heronry_tools.reports.plan"
    ),
    (
        "Packages of the simulator: scenarios and replays above flights, flights above oracles, faults and the world"
    ): Breach("tools/heronry_tools/sim/world", "heronry_tools.sim.faults.fault"),
    "Flights stand above all that flies: nothing below knows them or their flight dynamics": Breach(
        "tools/heronry_tools/sim/world", "heronry_tools.fly.record"
    ),
    "The avionics of flights run on PEs: they know the agent's API alone": Breach(
        "tools/heronry_tools/fly/avionics", "heronry_dg.model"
    ),
    "What is watched needs no simulator: views know no flight that is computed": Breach(
        "tools/heronry_tools/watch", "heronry_tools.sim.replay.rerun"
    ),
    "Only the pages need a web server": Breach("tools/heronry_tools/runtime", "starlette"),
    "The agent's shell may import its core, and the core no shell": Breach(
        "pe_agent/heronry_agent/core", "heronry_agent.shell.devices"
    ),
    "The manager's shell may import its planning policy, that its core, and the core neither": Breach(
        "manager/heronry_manager/core", "heronry_manager.planning_policy"
    ),
    "A core imports no clock, randomness, file, socket, thread, process, bus or solver": Breach(
        "manager/heronry_manager/core", "random"
    ),
    "Command lines are read before anything heavy is imported: they need the console and the wire": Breach(
        "tools/heronry_tools/command_lines", "heronry_dg.model"
    ),
    "The command table alone imports commands, and by name: no other import of one is there": Breach(
        "tests/lab", "heronry_tools.commands.sim"
    ),
    "No command imports another one: shared code lies below": Breach(
        "tools/heronry_tools/commands", "heronry_tools.commands.sim"
    ),
    "No command line imports another one: shared arguments lie in the console": Breach(
        "tools/heronry_tools/command_lines", "heronry_tools.command_lines.sim"
    ),
    "No two packages, and no two modules of a package, import each other, directly or not": Breach(
        "dg_specs/heronry_dg/rules", "heronry_dg.loader"
    ),
}


class Sources:
    """A copy of all packages, checked by `lint-imports`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for package in FOLDERS:
            ignored = shutil.ignore_patterns("__pycache__", "*.golden", "*.scenario")
            shutil.copytree(ROOT / package, folder / package, ignore=ignored)
        shutil.copy(ROOT / "pyproject.toml", folder)

    def broken(self, *breaches: Breach) -> set[str]:
        """Plant breaches, and give the contracts that they break."""
        planted = {
            self._folder / breach.room / f"planted_breach_{number}.py": breach for number, breach in enumerate(breaches)
        }
        for file, breach in planted.items():
            file.write_text(f"import {breach.imported}\n")
        search_path = os.pathsep.join(str(self._folder / package) for package in FOLDERS)
        done = subprocess.run(
            [Path(sys.executable).with_name("lint-imports"), "--no-logo"],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": search_path, "COLUMNS": "500"},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        for file in planted:
            file.unlink()
        said = " ".join(done.stdout.split())
        broken = {name for name in CONTRACTS if f"{name} BROKEN" in said}
        assert done.returncode == bool(broken), done.stdout + done.stderr
        assert all(f"{name} KEPT" in said for name in CONTRACTS.keys() - broken), done.stdout
        return broken


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Sources:
    return Sources(tmp_path_factory.mktemp("sources"))


def test_every_contract_has_a_breach_here() -> None:
    assert BREACHES.keys() == CONTRACTS.keys()


def test_the_sources_break_no_contract(sources: Sources) -> None:
    assert sources.broken() == set()


def test_all_breaches_together_fail(sources: Sources) -> None:
    assert sources.broken(*BREACHES.values()) == BREACHES.keys()


@pytest.mark.soak
@pytest.mark.parametrize("name", BREACHES)
def test_a_breach_alone_fails(sources: Sources, name: str) -> None:
    assert name in sources.broken(BREACHES[name])


@pytest.mark.parametrize(
    "forbidden",
    CONTRACTS["A core imports no clock, randomness, file, socket, thread, process, bus or solver"]["forbidden_modules"],
)
def test_nothing_that_a_core_must_not_touch_is_misspelt(forbidden: str) -> None:
    """A module that does not exist forbids nothing."""
    __import__(forbidden)
