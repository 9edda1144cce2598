"""The processes of a demo: the hubs of the software buses, the manager, every PE.

The demo starts, kills and restores these processes, and ends all of them when it ends. Each process of a node stands
for a computer of its own. Each hub stands for a wire, and a wire delays no frame. A manager that is late takes healthy
PEs for lost. So if this user may set priorities, these processes get a higher priority than all others on this
computer, and the hubs and managers get the highest.

The standard input of every child is a pipe from the demo's process. A child ends when the pipe ends (`--until-eof`). So
a demo that is itself killed leaves no process behind.

Each run of a demo has a folder, named after the demo's process and its process namespace (`_here`). The next start in
the same namespace removes the folders of processes that are gone. Each process writes its standard error to a log in
the folder; the log of an agent also has what its modules print. The logs of a run that failed are kept.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from heronry_dg.model import Spec
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.contingency.file_format import to_bytes
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import STANDBY, ControlError, default_socket
from heronry_manager.shell.control_protocol import Spoken
from heronry_tools.console.contingencies_argument import Ahead
from heronry_tools.console.errors import UserError
from heronry_tools.reports.story import RUNS_KEPT
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_tools.runtime.softbus.starter import HubProcess
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.identifiers import FIRST_MANAGER

_STOP_TIMEOUT_S = 5.0
_CENTRAL_PRIORITY, NODE_PRIORITY = -10, -5  # "niceness": the kernel allows negative ones to privileged users alone
_NAME, _LOGS = "heronry-demo-", "heronry-logs-"


def run_folder() -> Path:
    """Make the folder of this run, and remove the folders of runs that have ended."""
    home, here = Path(tempfile.gettempdir()), _here()
    for old in home.glob(f"{_NAME}*-{here}"):
        number = old.name.removeprefix(_NAME).removesuffix(f"-{here}")
        if number.isdecimal() and not Path(f"/proc/{number}").exists():
            shutil.rmtree(old, ignore_errors=True)
    folder = home / f"{_NAME}{os.getpid()}-{here}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(mode=0o700)
    return folder


def _here() -> str:
    """Return 8 hexadecimal digits that stand for this boot of the kernel and the PID namespace of this process.

    The name of a run's folder contains them: containers may share /tmp, and each has process numbers of its own.
    """
    kernel = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    space = Path("/proc/self/ns/pid").stat().st_ino
    return sha256(f"{kernel} {space}".encode()).hexdigest()[:8]


def keep_logs(folder: Path) -> Path:
    """Move the logs of a run into a folder that stays; returns it. Of older such folders only the newest few stay."""
    kept = folder.with_name(f"{_LOGS}{os.getuid()}-{os.getpid()}")
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(mode=0o700)
    for log in folder.glob("*.log"):
        log.rename(kept / log.name)
    own = [one for one in kept.parent.glob(f"{_LOGS}{os.getuid()}-*") if one != kept]
    for old in sorted(own, key=lambda one: one.stat().st_mtime)[: -RUNS_KEPT + 1]:
        shutil.rmtree(old, ignore_errors=True)
    return kept


class Fleet:
    """All processes of one run; a context manager, which ends all of them when its block is left."""

    def __init__(
        self,
        spec: Spec,
        spec_file: Path,
        folder: Path,
        made: Contingencies | None = None,
        key: Path | None = None,
        *,
        aloft_s: float = 0.0,
        called: str | None = None,
        heartbeat_ns: int | None = None,
        simulator: str | None = None,
        devices: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Write the files of the manager and of every PE: tables; also contingencies and a key, if there are any.

        aloft_s: how long the simulated flight has already lasted when the demo begins, in s.
        called: the name under which the operator's commands find the manager (`manager_name`). If it is None, the
            commands find the manager only by the path of its socket.
        heartbeat_ns: the shortest heartbeat period in `spec`, if the periods in `spec` are longer than those in
            `spec_file`; None: the periods are the same.
        simulator: name of the driver that simulates all devices; None for that of the scripted flight.
        devices: file with the drivers of real devices; None: all are simulated.
        environment: environment variables for all processes.
        """
        self.folder, self._called = folder, called
        self._contingency_flags = [
            "--contingencies",
            Ahead.NOTHING.value if made is None else str(folder / "contingencies"),
        ]
        if made is not None:
            (folder / "contingencies").write_bytes(to_bytes(made, spec))
        self._slower_flags = [] if heartbeat_ns is None else ["--slower-heartbeat-ns", str(heartbeat_ns)]
        self._key_flags = [] if key is None else ["--key", str(key)]
        self._driver_flags = ["--simulated", *([] if simulator is None else [simulator])]
        if devices is not None:
            self._driver_flags += ["--devices", str(devices.resolve())]
        self._environment = {**os.environ, **(environment or {})}
        self._spec, self._spec_file = spec, spec_file
        self._hubs: list[HubProcess] = []
        self._pes: dict[str, subprocess.Popen[bytes]] = {}
        self._managers: dict[int, subprocess.Popen[bytes]] = {}  # by node
        self._buses: Mapping[str, BusChoice] = {}
        self._tables = write_tables(spec, spec.pes, folder / "tables", made)
        self._plant_origin_ns = time.monotonic_ns() - round(aloft_s * 1e9)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end(signal.SIGKILL if kind is not None and issubclass(kind, KeyboardInterrupt) else signal.SIGTERM)

    def start_buses(self, choices: Mapping[str, BusChoice]) -> None:
        """Start a hub for each channel of the software buses of this run; `choices`: by name of the spec's bus."""
        self._buses = choices
        for choice in choices.values():
            for config in choice.configs() if choice.is_ours else ():
                bitrate = choice.bitrate or self._spec.buses[choice.name].bitrate
                self._hubs.append(HubProcess(Path(config["channel"]), bitrate))
                _prefer(self._hubs[-1].pid, _CENTRAL_PRIORITY)
        for hub in self._hubs:  # they start side by side
            hub.wait_until_up()

    def start_manager(self, node: int = FIRST_MANAGER, *, standby: bool = False) -> IO[bytes]:
        """Start a manager, active or standby; returns the stream of its events."""
        arguments = ["heronry_tools.cli", "manager", str(self._spec_file), "--json", "--until-eof"]
        arguments += ["--node", str(node), *(["--standby"] if standby else [])]
        arguments += ["--state-dir", str(self.folder), "--socket", str(self.control_socket(node))]
        arguments += [*_bus_flags(self._buses[self._spec.manager.bus]), *self._key_flags, *self._contingency_flags]
        arguments += self._slower_flags
        name = "manager" if node == FIRST_MANAGER else "standby"
        process = self._start(name, arguments, stdout=subprocess.PIPE, priority=_CENTRAL_PRIORITY)
        self._managers[node] = process
        assert process.stdout is not None
        return process.stdout

    def control_socket(self, node: int = FIRST_MANAGER) -> Path:
        """Return the path of a manager's control socket."""
        if self._called is None:
            return self.folder / f"manager-{node}.sock"
        return default_socket(self._called if node == FIRST_MANAGER else f"{self._called}{STANDBY}")

    def active_manager(self) -> int:
        """Return the node-ID of the active manager: on a busy computer the standby manager may have taken over.

        If there are two managers, each is asked for its status, which shows whether it is active. If no status shows
        this, the result is the lower node-ID.
        """
        if len(self._managers) > 1:
            for node in self._managers:
                with contextlib.suppress(ControlError):
                    status = call(self.control_socket(node), AskStatus()).status
                    if status is not None and status["manager"]["state"] in ("starting", "active"):
                        return node
        return min(self._managers)

    def kill_manager(self, node: int | None = None) -> int:
        """Kill a manager, by default the active one, with SIGKILL; returns its process number."""
        victim = self.active_manager() if node is None else node
        process = self._managers.pop(victim)
        process.kill()
        process.wait()
        self.control_socket(victim).unlink(missing_ok=True)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
        return process.pid

    def order(self, order: Spoken, place: str) -> None:
        """Give an order to the active manager.

        Raises UserError, whose message begins with `place`, if the manager refuses the order or does not answer.
        """
        try:
            answer = call(self.control_socket(self.active_manager()), order)
        except ControlError as error:
            raise UserError(f"{place}: {error}") from None
        if not answer.done:
            raise UserError(f"{place}: {answer.sentence}")

    def stop(self, node: str | int) -> None:
        """Suspend the process of a node (SIGSTOP); `go_on` lets the process continue.

        node: the name of a PE, or the node-ID of a manager. Raises UserError if this node does not run.
        """
        self._process(node).send_signal(signal.SIGSTOP)

    def go_on(self, node: str | int) -> None:
        """Let a stopped process go on (SIGCONT)."""
        self._process(node).send_signal(signal.SIGCONT)

    def _process(self, node: str | int) -> subprocess.Popen[bytes]:
        process = self._pes.get(node) if isinstance(node, str) else self._managers.get(node)
        if process is None:
            name = f"pe:{node}" if isinstance(node, str) else f"manager {node}"
            raise UserError(
                f"{name} does not run at that time, so its process cannot be paused or continued; choose another time"
            )
        return process

    def start_pe(self, pe: str) -> int:
        """Start a PE's agent; gives its process number."""
        own = [self._buses[bus] for bus in self._spec.pes[pe].buses]
        arguments = ["heronry_agent", "--table", str(self._tables[pe]), "--until-eof", "--state-dir", str(self.folder)]
        arguments += [f"--bench-origin={self._plant_origin_ns}", *self._key_flags, *self._driver_flags]
        for choice in own:
            arguments += ["--bus", choice.port_argument()]
        self._pes[pe] = self._start(pe, arguments)
        return self._pes[pe].pid

    def has_pe(self, pe: str) -> bool:
        """Tell whether a PE's process has been started, and not been killed since."""
        return pe in self._pes

    def kill_pe(self, pe: str) -> int:
        """Kill a PE with SIGKILL; gives its process number."""
        process = self._pes.pop(pe, None)
        if process is None:
            raise UserError(f"pe:{pe} does not run, so it cannot be killed; choose another PE, or another time")
        process.kill()
        process.wait()
        if process.stdin is not None:
            process.stdin.close()
        return process.pid

    def processes(self) -> dict[str, int]:
        """Return the process numbers of what runs: 'pe:NAME', 'manager NODE', 'bus NAME' (a software bus)."""
        managers = {f"manager {node}": process.pid for node, process in self._managers.items()}
        hubs = {f"bus {hub.path.stem}": hub.pid for hub in self._hubs}
        return {**{f"pe:{pe}": process.pid for pe, process in self._pes.items()}, **managers, **hubs}

    def ended(self) -> str | None:
        """Return a sentence about a manager's or PE's process that has ended by itself; None while all of these run."""
        managers = [("the manager", process) for process in self._managers.values()]
        for name, process in [*managers, *self._pes.items()]:
            if process.poll() is not None:
                return f"{name} ended with exit code {process.returncode}: {self.last_words(name.removeprefix('the '))}"
        return None

    def last_words(self, name: str) -> str:
        """Return the last line that a process wrote to its standard error.

        If the process wrote nothing, give a sentence that says so.
        """
        log = self.folder / f"{name}.log"
        lines = log.read_text(errors="replace").strip().splitlines() if log.exists() else []
        return lines[-1] if lines else "it wrote no message"

    def keep_logs(self) -> Path:
        """Move the logs out of this run's folder, which `close` removes; returns their new folder."""
        return keep_logs(self.folder)

    def close(self) -> None:
        """End all processes: with SIGTERM, and with SIGKILL those that do not end."""
        self._end(signal.SIGTERM)

    def _end(self, number: signal.Signals) -> None:
        """Send the signal `number` to all processes, and kill those that do not end within _STOP_TIMEOUT_S.

        After an interruption of the demo (Ctrl-C), `number` is SIGKILL, so that the user need not wait.
        """
        running = [*self._pes.values(), *self._managers.values()]
        for process in running:
            process.send_signal(number)
            process.send_signal(signal.SIGCONT)
        deadline = time.monotonic() + _STOP_TIMEOUT_S
        for process in running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    stream.close()
        for node in self._managers:
            self.control_socket(node).unlink(missing_ok=True)
        for hub in self._hubs:
            hub.close()
        self._pes, self._managers, self._hubs = {}, {}, []
        shutil.rmtree(self.folder, ignore_errors=True)

    def _start(
        self, name: str, arguments: list[str], stdout: int = subprocess.DEVNULL, priority: int = NODE_PRIORITY
    ) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdin=subprocess.PIPE,
                stdout=stdout,
                stderr=log,
                process_group=0,
                env=self._environment,
            )
        _prefer(process.pid, priority)
        return process


def _prefer(process: int, priority: int) -> None:
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, process, priority)


def _bus_flags(choice: BusChoice) -> list[str]:
    flags = ["-i", choice.interface, "-c", choice.channel]
    return flags if choice.bitrate is None else [*flags, "-b", str(choice.bitrate)]
