"""The simulator as machine code, which `heronry sim --compiled` flies: four times as fast, with equal frames.

A campaign of thousands of flights needs speed, but must fly the same cores as an aircraft. So it flies a compiled form
of them: mypyc, a part of mypy, translates typed Python to C. This is done with a copy of all packages in the user's
cache folder. There the modules in which a flight spends its time have a compiled form beside their source, and Python
imports the compiled form. No module of a flight asks whether it is compiled.

The folder of a copy is named by the digest of sources, specs, Python and mypy. So changed sources give another copy,
and no old copy is flown. One process at a time makes a copy under another name, and renames it when it is complete. A
copy that was not used for a month is deleted.

Compiled code differs from Python where a declared type is less exact than the value:

- A tuple of fixed length has no identity.
- A member of an IntEnum that is declared as an int is only an int.
- An int that is passed as a float becomes a float.
- A protocol is no class that `isinstance` can check, so `heronry_agent.shell.devices` stays Python.

So `proof_flights` are flown in both forms, and must give the same frames. If they do not, the copy is not kept.
"""

import fcntl
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import heronry_agent
import heronry_dg
import heronry_manager
import heronry_tools
import heronry_wire
from heronry_dg.loader import SUFFIX
from heronry_dg.shipped import example_specs, flight_specs, shipped_spec_names, shipped_spec_path
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import show_line
from heronry_tools.console.user_cache import digest_of, user_cache
from heronry_tools.sim.compiled.native_classes import with_native_classes
from heronry_tools.sim.world import clock

_PACKAGES = (heronry_wire, heronry_dg, heronry_agent, heronry_manager, heronry_tools)
# Modules in which a flight spends its time; others stay Python, whose tracebacks say more.
_COMPILED = {
    "heronry_wire": "authentication canaerospace command_tags configuration_slice frame gateway_report "
    "identifiers layout management packing protocol_times sansio silence state_frames timing",
    "heronry_agent": "module",
    "heronry_agent.core": "agent command_acceptance condition deadlines inbound restarts step_times table_index turn "
    "vocabulary",
    "heronry_agent.core.authority": "authenticity exclusive_frames followed_manager nonces output_authorization "
    "passing_welcomes state_seal",
    "heronry_agent.core.canopen": "canopen_node",
    "heronry_agent.core.configuration": "active_configuration staging",
    "heronry_agent.core.forwarding": "gateway link_meter radio_port radio_queue radios",
    "heronry_agent.core.modules": "mailboxes module_reports notices phase_requests publishing running_modules "
    "schedule silence_watch without_manager",
    "heronry_agent.core.reports": "faults reporting silence_reports",
    "heronry_agent.parts": "reading",
    "heronry_agent.shell": "module_runner reading_watch start_orders",
    "heronry_manager.core": "knowledge manager turn vocabulary",
    "heronry_manager.core.authentication": "authenticity",
    "heronry_manager.core.epochs": "activation deployment epoch known_epochs observation silences",
    "heronry_manager.core.heartbeat": "announcing beacon beat",
    "heronry_manager.core.intake": "hearer inbound pe_reports reactions succession",
    "heronry_manager.core.mastership": "claim following overheard",
    "heronry_manager.core.membership": "exclusion health standing",
    "heronry_manager.core.planning": "replanning requests",
    "heronry_manager.core.situation": "known_situation latched_faults radio_links",
    "heronry_tools.aircraft.images": "actuators air_data altitude atmosphere attitude control guidance "
    "imaging mission pilot_view recovery sensors servo_monitor telemetry wing",
    "heronry_tools.aircraft.plant": "devices flight interface mechanism noise world",
    "heronry_tools.fly": "atmosphere camera observation sensors servos",
    "heronry_tools.fly.avionics": "control flight_management position tracking_filter",
    "heronry_tools.fly.dynamics": "eav moving_air",
    "heronry_tools.recording": "commanded",
    "heronry_tools.runtime": "witness",
    "heronry_tools.sim.faults": "protocol_state",
    "heronry_tools.sim.oracles": "authenticity availability blame channels checkpoints checks code configurations "
    "either_spec end_state epochs exclusion frames freshness journal known liveness load oracle orphans phase places "
    "planned_load priorities progress proven_commands proven_states publishing queues radio registry active_term "
    "safe_mode scripts service silence solitude stale tables terms transitions violation",
    "heronry_tools.sim.world": "bus clock frame_digest local_clock module_host module_steps node pe_outbox "
    "plant_view simulated_blank simulated_manager simulated_pe station steps_seen",
}
# Classes created for every frame or step that hold only values; no code unpacks those that are named tuples.
_MADE_OFTEN = frozenset(
    [
        *("Datum", "Drive", "Driven", "Facts", "Frame", "Left", "Output", "Received", "Result", "Send", "Sent"),
        *("StatePage0", "StepModule", "Stepped", "Tick"),
    ]
)
_DERIVED_FROM = frozenset(("Module", "TrackedPosition"))  # of modules, and of other versions of kept ones
# Only the packages of heronry are type-checked; other packages would take most of the time.
_TYPE_SETTINGS = """\
[mypy]
mypy_path = $MYPY_CONFIG_FILE_DIR
ignore_missing_imports = true
[mypy-can.*,canopen.*,cantools.*,cryptography.*,distributed.*,highspy.*,jsbsim.*,ortools.*,pydantic.*,rich.*,yaml.*]
follow_imports = skip
"""
# Hidden symbols make calls within the library direct. More optimisation is hardly faster. The check for misleading
# indentation would make gcc read the file (90 MB) again and again, for minutes.
_COMPILER = {
    "MYPYC_OPT_LEVEL": "1",
    "MYPYC_DEBUG_LEVEL": "0",
    "CFLAGS": "-fvisibility=hidden -Wno-misleading-indentation",
}
_TOLD = 2000  # characters at the end of a compiler's output that are shown
_KEPT_S = 30 * 86_400
_NOTE = "compiling the simulator, once for these sources: this takes a minute or two"


def is_compiled() -> bool:
    """Tell whether this process runs the compiled form of the simulator."""
    return not str(clock.__file__).endswith(".py")


def go_on_compiled(command: Sequence[str], program: str = "heronry_tools.cli") -> None:
    """Replace this process by one that runs `command` in the compiled form; no effect if this process is compiled.

    If these sources have not been compiled yet, they are compiled first. Raises UserError if that is not possible.
    """
    if is_compiled():
        return
    folder = compiled_folder()
    if str(folder) in sys.path:
        raise UserError(f"Python finds other sources of heronry before those in {folder}: unset PYTHONPATH")
    if not folder.is_dir():
        print(_NOTE, file=sys.stderr)
        make(folder)
    os.utime(folder)
    python = (sys.executable, "-P", "-m", program)
    os.execve(sys.executable, (*python, *command), environment(folder))  # noqa: S606 - this very program


def compiled_folder() -> Path:
    """Return the folder for the compiled form of the present sources of the simulator; it need not exist.

    The folder depends on Python and mypy, too. Raises UserError if mypy is not installed.
    """
    try:
        maker = f"{sys.version} {platform.machine()} mypy {version('mypy')}"
    except PackageNotFoundError:
        raise UserError('--compiled needs mypy, which is not installed: pip install "heronry[dev]"') from None
    return user_cache("compiled") / digest_of(maker, sorted(_copied()))


def environment(folder: Path) -> dict[str, str]:
    """Return environment variables for a process that imports the packages in `folder`."""
    path = filter(None, (str(folder), os.environ.get("PYTHONPATH")))
    return os.environ | {"PYTHONPATH": os.pathsep.join(path)}


def make(folder: Path) -> None:
    """Compile the simulator into a new folder, and verify by flights that it gives the same frames as Python.

    Raises UserError if the simulator cannot be compiled, or gives other frames.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with (folder.parent / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.is_dir():  # if it exists, another process has made it while this one waited
                _make(folder.parent / "staging", folder)
    except OSError as error:
        problem = f"{folder.parent} cannot be written ({error.strerror})"
        raise UserError(f"{problem}: set XDG_CACHE_HOME to a folder that you can write") from error


def _make(staging: Path, folder: Path) -> None:
    try:
        compile_into(staging)
        if compiled_folder().name != folder.name:
            raise UserError("heronry's sources changed while they were compiled: start the command again")
        flights = ("-P", "-m", "heronry_tools.sim.compiled.proof_flights")
        if _run("flying in Python", flights, None) != _run("flying compiled", flights, staging):
            raise UserError("compiled flights give other frames than Python: report this, and fly without --compiled")
        staging.rename(folder)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    forget_old(folder.parent, time.time())


def forget_old(cache: Path, now_s: float) -> None:
    """Delete the compiled copies below `cache` that were not used for a month; `now_s` is the present time."""
    for folder in cache.iterdir():
        if folder.is_dir() and now_s - folder.stat().st_mtime > _KEPT_S:
            shutil.rmtree(folder, ignore_errors=True)


def compile_into(folder: Path, files: Iterable[Path] | None = None) -> None:
    """Copy all packages to `folder`, and compile `files` in this copy, by default all of `sources`.

    Raises UserError if compiling fails.
    """
    compiler = (os.environ.get("CC") or "cc").split()[0]
    if shutil.which(compiler) is None:
        raise UserError(f"the C compiler {compiler} is not found: install one (Debian: apt install gcc libc6-dev)")
    shutil.rmtree(folder, ignore_errors=True)
    for name, file in _copied():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, folder / name)
    (folder / "mypy.ini").write_text(_TYPE_SETTINGS)
    chosen = list(sources() if files is None else files)
    for file in (folder / one for one in chosen):
        if file.is_file():  # else mypyc will report it
            file.write_text(with_native_classes(file.read_text(), _MADE_OFTEN, _DERIVED_FROM))
    _run("compiling", ("-m", "mypyc", *map(str, chosen)), folder)
    for name, file in _copied():  # the digest of a module's code is that of its source, not of what was compiled
        shutil.copyfile(file, folder / name)
    for left in ("build", ".mypy_cache"):
        shutil.rmtree(folder / left, ignore_errors=True)


def sources() -> Iterator[Path]:
    """Yield the files to compile, relative to the folder that holds the packages."""
    for package, modules in _COMPILED.items():
        for module in modules.split():
            yield Path(*package.split("."), f"{module}.py")


def _copied() -> Iterator[tuple[str, Path]]:
    """Yield, for each file to copy, its path in the folder of the copies, and the file itself.

    These are the files of the packages and the shipped specs. Shipped specs get the place that they have in a wheel.
    """
    for package in _PACKAGES:
        root = Path(package.__path__[0])
        for file in root.rglob("*"):
            if file.is_file() and file.suffix not in (".pyc", ".so"):
                yield str(Path(package.__name__) / file.relative_to(root)), file
    for name in shipped_spec_names():
        yield f"heronry_dg/specs/{name}{SUFFIX}", shipped_spec_path(name)
    for file in example_specs():
        yield f"heronry_dg/specs/examples/{file.name}", file
    for file in flight_specs():
        yield f"heronry_dg/specs/flights/{file.name}", file


def _run(what: str, words: Sequence[str], folder: Path | None) -> str:
    """Run Python with the packages in `folder` (None: with those of this process), and return what it prints.

    Raises UserError if Python fails; the message begins with `what`.
    """
    own = os.environ if folder is None else environment(folder) | _COMPILER
    command, pipe = (sys.executable, *words), subprocess.PIPE
    with subprocess.Popen(command, cwd=folder, env=own, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            told, wrong = _watched(what, process)
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        remedy = "mend what this output names, or leave --compiled out"
        raise UserError(f"{what} failed; {remedy}:\n{(wrong + told)[-_TOLD:]}")
    return told


def _watched(what: str, process: "subprocess.Popen[str]") -> tuple[str, str]:
    """Wait for the end of a process, and return its standard output and standard error.

    On a terminal, show `what` and the time that the process has taken so far.
    """
    began_s = time.monotonic()
    while True:
        try:
            told = process.communicate(timeout=1)
        except subprocess.TimeoutExpired:
            show_line(f"{what}: {time.monotonic() - began_s:.0f} s")
        else:
            show_line("")
            return told
