"""The simulator as machine code, for campaigns: what `heronry sim --compiled` flies.

A campaign of thousands of flights needs speed, and its cores must be those that fly. mypyc, which comes with mypy,
turns typed Python into C: one source, the same frames bit for bit, and a third of the time. What is compiled is a copy
of all packages, in the user's cache; Python takes the compiled form of a module where it stands beside its source.
No part that flies knows of it.

A copy is named by the digest of its sources, specs, Python and mypy: changed sources give another copy, so nothing
stale is ever flown. It is made under another name and renamed in one step, by one process at a time: a copy that is
there is complete. A copy that was not used for a month is deleted.

Compiled code differs from Python where a type is less exact than the value: a tuple of fixed length has no identity, a
member of an IntEnum that may be any int is one, an int that is passed on as a float becomes a float. So `proof_flights`
are flown in both forms, and must give the same frames; else the copy is not kept.
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
from heronry_dg.shipped import example_specs, shipped_spec_names, shipped_spec_path
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import show_line
from heronry_tools.console.user_cache import digest_of, user_cache
from heronry_tools.sim.compiled.native_classes import with_native_classes
from heronry_tools.sim.world import clock

_PACKAGES = (heronry_wire, heronry_dg, heronry_agent, heronry_manager, heronry_tools)
# What a flight spends its time in; what is called seldom stays Python, where a traceback tells more.
_COMPILED = {
    "heronry_wire": "authentication canaerospace command_tags configuration_slice frame gateway_report "
    "identifiers layout management packing protocol_times sansio state_frames timing",
    "heronry_agent": "module",
    "heronry_agent.core": "agent authenticity canopen_node command_acceptance condition deadlines faults gateway "
    "inbound link_meter mailboxes mastership nonces output_authorization passing_welcomes phase_requests publishing "
    "radio_port radio_queue radios reconfiguration reporting restarts running_modules schedule staging state_seal "
    "table_index turn vocabulary without_manager",
    "heronry_agent.parts": "reading",
    "heronry_agent.shell": "devices module_runner start_orders",
    "heronry_manager.core": "activation announcing authenticity beacon beat deployment epochs exclusion following "
    "health inbound knowledge known_situation latched_faults manager mastership observation overheard pe_reports "
    "planning radio_links reactions reconfiguration replanning standing succession turn vocabulary",
    "heronry_tools.aircraft.images": "actuators air_data altitude atmosphere attitude control guidance "
    "imaging mission pilot_view recovery sensors servo_monitor telemetry wing",
    "heronry_tools.aircraft.plant": "devices flight mechanism noise world",
    "heronry_tools.runtime": "witness",
    "heronry_tools.sim.faults": "protocol_state",
    "heronry_tools.sim.oracles": "authenticity blame channels checks commanded configurations end_state epochs "
    "exclusion frames freshness journal known liveness load oracle orphans phase planned_load proven_commands "
    "proven_states publishing queues radio registry active_term safe_mode service silence solitude terms "
    "transitions violation",
    "heronry_tools.sim.world": "bus clock frame_digest local_clock module_host module_steps node pe_outbox "
    "plant_view simulated_manager simulated_pe station steps_seen",
}
# Values that are made for every frame or step, and that hold only values; no code unpacks the named tuples.
_MADE_OFTEN = frozenset(
    [
        *("Datum", "Drive", "Driven", "Facts", "Frame", "Left", "Output", "Received", "Result", "Send", "Sent"),
        *("StatePage0", "StepModule", "Stepped", "Tick"),
    ]
)
_DERIVED_FROM = frozenset(("Module",))  # by the modules of an aircraft
# Types of our own packages are what counts; those of others would take most of the time.
_TYPE_SETTINGS = """\
[mypy]
mypy_path = $MYPY_CONFIG_FILE_DIR
ignore_missing_imports = true
[mypy-can.*,canopen.*,cantools.*,cryptography.*,distributed.*,highspy.*,ortools.*,pydantic.*,rich.*,yaml.*]
follow_imports = skip
"""
# One library, whose calls within itself go straight there. More optimisation is hardly faster. To look for misleading
# indentation, gcc reads the file (90 MB) again from its beginning, again and again: minutes.
_COMPILER = {
    "MYPYC_OPT_LEVEL": "1",
    "MYPYC_DEBUG_LEVEL": "0",
    "CFLAGS": "-fvisibility=hidden -Wno-misleading-indentation",
}
_TOLD = 2000  # characters of the end of a compiler's output
_KEPT_S = 30 * 86_400
_NOTE = "compiling the simulator, once for these sources: this takes a minute or two"


def is_compiled() -> bool:
    """Tell whether this process flies the compiled form."""
    return not str(clock.__file__).endswith(".py")


def go_on_compiled(command: Sequence[str], program: str = "heronry_tools.cli") -> None:
    """Replace this process by one that runs the same command with the compiled form; does nothing if it runs already.

    Makes that form where it is not there yet. Raises UserError where that cannot be done.
    """
    if is_compiled():
        return
    folder = compiled_folder()
    if str(folder) in sys.path:
        raise UserError(f"other sources of heronry come before {folder} on Python's path: unset PYTHONPATH")
    if not folder.is_dir():
        print(_NOTE, file=sys.stderr)
        make(folder)
    os.utime(folder)
    python = (sys.executable, "-P", "-m", program)
    os.execve(sys.executable, (*python, *command), environment(folder))  # noqa: S606 - this very program


def compiled_folder() -> Path:
    """Where the compiled form of these sources is, or would be; raises UserError without a mypy to make it."""
    try:
        maker = f"{sys.version} {platform.machine()} mypy {version('mypy')}"
    except PackageNotFoundError:
        raise UserError('mypy is needed to compile, and not installed: pip install "heronry[dev]"') from None
    return user_cache("compiled") / digest_of(maker, sorted(_copied()))


def environment(folder: Path) -> dict[str, str]:
    """Environment of a process that is to run the packages of a folder."""
    path = filter(None, (str(folder), os.environ.get("PYTHONPATH")))
    return os.environ | {"PYTHONPATH": os.pathsep.join(path)}


def make(folder: Path) -> None:
    """Compile into a folder that is not there, and prove that it flies as Python does; raises UserError."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with (folder.parent / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.is_dir():  # else another process has made it while this one waited
                _make(folder.parent / "staging", folder)
    except OSError as error:
        problem = f"{folder.parent} cannot be written ({error.strerror})"
        raise UserError(f"{problem}: set XDG_CACHE_HOME to a folder of yours") from error


def _make(staging: Path, folder: Path) -> None:
    try:
        compile_into(staging)
        if compiled_folder().name != folder.name:
            raise UserError("the sources have changed while they were compiled: start again")
        flights = ("-P", "-m", "heronry_tools.sim.compiled.proof_flights")
        if _run("flying in Python", flights, None) != _run("flying compiled", flights, staging):
            raise UserError("the compiled flights give other frames than those in Python: report this, fly in Python")
        staging.rename(folder)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    forget_old(folder.parent, time.time())


def forget_old(cache: Path, now_s: float) -> None:
    """Delete the copies that were not used for a month."""
    for folder in cache.iterdir():
        if folder.is_dir() and now_s - folder.stat().st_mtime > _KEPT_S:
            shutil.rmtree(folder, ignore_errors=True)


def compile_into(folder: Path, files: Iterable[Path] | None = None) -> None:
    """Make a copy of all packages, with these files compiled or all of `sources`; raises UserError."""
    compiler = (os.environ.get("CC") or "cc").split()[0]
    if shutil.which(compiler) is None:
        raise UserError(f"there is no C compiler {compiler} here: install one (Debian: apt install gcc libc6-dev)")
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
    for left in ("build", ".mypy_cache"):
        shutil.rmtree(folder / left, ignore_errors=True)


def sources() -> Iterator[Path]:
    """Files that are compiled, from the folder that holds the packages."""
    for package, modules in _COMPILED.items():
        for module in modules.split():
            yield Path(*package.split("."), f"{module}.py")


def _copied() -> Iterator[tuple[str, Path]]:
    """Every file of the packages, by its name in the copy; the shipped specs among them, as in a wheel."""
    for package in _PACKAGES:
        root = Path(package.__path__[0])
        for file in root.rglob("*"):
            if file.is_file() and file.suffix not in (".pyc", ".so"):
                yield str(Path(package.__name__) / file.relative_to(root)), file
    for name in shipped_spec_names():
        yield f"heronry_dg/specs/{name}{SUFFIX}", shipped_spec_path(name)
    for file in example_specs():
        yield f"heronry_dg/specs/examples/{file.name}", file


def _run(what: str, words: Sequence[str], folder: Path | None) -> str:
    """Run Python with the packages of a folder, or with those of this process; raises UserError if it fails."""
    own = os.environ if folder is None else environment(folder) | _COMPILER
    command, pipe = (sys.executable, *words), subprocess.PIPE
    with subprocess.Popen(command, cwd=folder, env=own, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            told, wrong = _watched(what, process)
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        raise UserError(f"{what} failed:\n{(wrong + told)[-_TOLD:]}")
    return told


def _watched(what: str, process: "subprocess.Popen[str]") -> tuple[str, str]:
    """Wait for the end of a process; a terminal shows how long it has taken so far."""
    began_s = time.monotonic()
    while True:
        try:
            told = process.communicate(timeout=1)
        except subprocess.TimeoutExpired:
            show_line(f"{what}: {time.monotonic() - began_s:.0f} s")
        else:
            show_line("")
            return told
