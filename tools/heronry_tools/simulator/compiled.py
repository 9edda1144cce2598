"""The simulator as machine code: `python -m heronry_tools.simulator.compiled FOLDER`.

A campaign of thousands of flights wants speed, and its cores must be those that fly. mypyc, which comes with mypy,
turns typed Python into C: one source, the same frames bit for bit, and less than half of the time. FOLDER gets a copy
of all packages; what is busy in a flight is compiled there beside its source, and Python takes the compiled form where
it finds both. Who wants it puts FOLDER before everything else:

    PYTHONPATH=FOLDER heronry sim big_blue --runs 1000 --jobs 2

Nothing that flies knows of it, and what is changed afterwards is not in it: compile again. Modules of your own cannot
be derived from a compiled `Module`: an aircraft that has some flies in Python.

Compiled code differs from Python where a type tells less than the truth: a tuple of fixed length has no identity, a
member of an IntEnum that may be any int is one, an int that is passed on as a float becomes a float. So a flight with
faults is flown before and after, and must give the same frames; else the folder is not kept.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import heronry_agent
import heronry_dg
import heronry_manager
import heronry_tools
import heronry_wire
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.errors import UserError

_PACKAGES = (heronry_wire, heronry_dg, heronry_agent, heronry_manager, heronry_tools)
# What a flight spends its time in; what is called once in a while stays Python, where a traceback tells more.
_COMPILED = {
    "heronry_wire": "authentication canaerospace configuration_slice frame gateway_report identifiers layout "
    "management packing timing",
    "heronry_agent": "canopen_node core faults gateway host link_meter mailboxes module obedience permission "
    "phase_requests publishing radio_port radio_queue reconfiguration reign reporting running_modules schedule staging "
    "table_index turn vocabulary bench.devices bench.flight bench.mechanism bench.noise bench.world images.actuators "
    "images.air_data images.altitude images.atmosphere images.attitude images.control images.guidance images.imaging "
    "images.mission images.pilot_view images.reading images.recovery images.sensors images.servo_monitor "
    "images.telemetry images.wing without_manager",
    "heronry_manager": "beacon core deployment exclusion health known_situation latched_faults planning radio_links "
    "reconfiguration turn vocabulary",
    "heronry_tools": "witness simulator.bus simulator.check_blame simulator.check_configurations "
    "simulator.check_end_state simulator.check_epochs simulator.check_exclusion simulator.check_freshness "
    "simulator.check_liveness simulator.check_load simulator.check_planned_load simulator.check_publishing "
    "simulator.check_queues simulator.check_radio simulator.check_safe_mode simulator.check_service "
    "simulator.check_silence simulator.checks simulator.clock simulator.commanded simulator.local_clock simulator.node "
    "simulator.nodes simulator.protocol_state simulator.station simulator.violation simulator.world",
}
# Types of our own packages are what counts; those of others would take most of the time.
_TYPE_SETTINGS = """\
[mypy]
mypy_path = $MYPY_CONFIG_FILE_DIR
ignore_missing_imports = true
[mypy-can.*,canopen.*,cantools.*,cryptography.*,distributed.*,highspy.*,ortools.*,pydantic.*,rich.*,yaml.*]
follow_imports = skip
"""
_FLIGHT = ("sim", "big_blue", "--seed", "1", "--seconds", "2", "--json")
_TOLD = 2000  # characters of a compiler's last words


def main() -> int:
    """Compile; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m heronry_tools.simulator.compiled",
        description="Compile the cores and the simulator, for campaigns. Takes a C compiler and a few minutes.",
        epilog="then:  PYTHONPATH=FOLDER heronry sim big_blue --runs 1000 --jobs 2",
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="made anew; for example build/compiled")
    folder: Path = parser.parse_args().folder.resolve()
    try:
        compile_into(folder)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"compiled; use it so:  PYTHONPATH={folder} heronry sim big_blue --runs 100")
    return 0


def compile_into(folder: Path, files: Iterable[Path] | None = None) -> None:
    """Make the folder, with these files compiled or all of `sources`; raises UserError, and then leaves none."""
    if folder.exists() and not (folder / "mypy.ini").is_file():
        raise UserError(f"{folder} is there already and was not made by this command: name another folder")
    shutil.rmtree(folder, ignore_errors=True)
    try:
        copy_packages(folder)
        frames = _frames(folder)
        _run(folder, "-m", "mypyc", *map(str, sources() if files is None else files))
        shutil.rmtree(folder / "build")
        if _frames(folder) != frames:
            _refuse()
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def sources() -> Iterable[Path]:
    """Files that are compiled, from the folder that holds the packages."""
    for package, modules in _COMPILED.items():
        for module in modules.split():
            yield Path(package, *module.split(".")).with_suffix(".py")


def copy_packages(folder: Path) -> None:
    """Copy the packages as they are, with the specs that come with them."""
    for package in _PACKAGES:
        shutil.copytree(package.__path__[0], folder / package.__name__, ignore=shutil.ignore_patterns("__pycache__"))
    specs = folder / "heronry_dg" / "specs"
    specs.mkdir(exist_ok=True)
    for name in shipped_spec_names():
        shutil.copy(shipped_spec_path(name), specs)
    (folder / "mypy.ini").write_text(_TYPE_SETTINGS)


def _refuse() -> NoReturn:
    raise UserError("the compiled flight gives other frames than the one in Python: do not use it, and report this")


def _frames(folder: Path) -> tuple[str, int]:
    """Digest and number of the frames of a flight, with the packages of a folder."""
    flight = json.loads(_run(folder, "-m", "heronry_tools.cli", *_FLIGHT))
    return flight["digest"], flight["frames"]


def _run(folder: Path, *words: str) -> str:
    """Run Python in a folder, with what is there; raises UserError with the last words of what fails."""
    own = os.environ | {"PYTHONPATH": str(folder), "MYPYC_OPT_LEVEL": "2"}
    done = subprocess.run([sys.executable, *words], cwd=folder, env=own, capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(f"{' '.join(words[:2])} failed in {folder}:\n{(done.stderr + done.stdout)[-_TOLD:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
