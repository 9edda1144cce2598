"""Runs one command inside a user-mode Linux: a kernel that is a process, with vcan, over the host's own file system.

This file boots Debian's user-mode-linux with `guest.py` as its first process. It passes on the command's output while
the command runs, and returns the exit code of the command. The guest has no privilege: it can change only those files
of the host that the user of this program can change.

In each of these cases the guest's process group is killed:

- The guest's kernel stops early, so there is no file with a result. The kernel's last output is shown.
- The command runs too long (ExpiredError).
- A signal stops this program: the handler of the signal raises an exception.
- This program itself is killed. Then the kernel of the host kills the process of the guest's kernel, and a shell, which
  this program has started for this case, kills the whole process group.

All files of a run are in one temporary folder. The guest's memory is a file without a name, which disappears with the
guest.
"""

import ctypes
import json
import os
import platform
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from heronry_tools.runtime.vcan import debian_packages, guest
from heronry_tools.runtime.vcan.command import Command, ExpiredError
from heronry_tools.runtime.vcan.errors import CannotRunError
from heronry_tools.runtime.vcan.job import Job, Result
from heronry_tools.runtime.vcan.streams import Streams
from heronry_wire.parent_death import die_with

MEMORY_MIB = 2048  # a sparse file: only what the guest touches is taken
MEMORY_LEAST_FREE_BYTES = 1 << 30
POLL_S = 0.02
MODULES = ("can-dev", "can", "can-raw", "can-bcm", "can-gw", "vcan")  # each after those it needs
_PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h
TAIL_LINES = 12
_KILL_GROUP_AT_EOF = 'read -r _; kill -s KILL -- "-$1"'


def run(command: Command, interfaces: list[str], expired: Callable[[], bool]) -> int:
    """Run `command` in a guest that has the CAN interfaces `interfaces`, and return its exit code.

    The exit code is 128 + n if signal n ended the command. Raises CannotRunError if the guest cannot run the
    command, ExpiredError as soon as `expired` returns True, or what a signal handler of this process raises.
    """
    kernel = debian_packages.unpacked("user-mode-linux")
    busybox = debian_packages.unpacked("busybox-static") / "bin" / "busybox"
    with _job_folder() as folder:
        _build_xstate(folder / "xstate.so")
        streams = Streams(folder)
        job = _job(command, interfaces, streams, folder, busybox=busybox, modules=_modules(kernel))
        (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
        try:
            with _booted(kernel / "usr" / "bin" / "linux.uml", folder, streams) as process:
                while process.poll() is None:
                    if expired():
                        raise ExpiredError
                    if not streams.pump():
                        time.sleep(POLL_S)
            streams.pump()
        finally:
            streams.close()
        return _exit_code(folder)


def _job(
    command: Command, interfaces: list[str], streams: Streams, folder: Path, *, busybox: Path, modules: list[str]
) -> Job:
    umask = os.umask(0o77)
    os.umask(umask)
    columns, rows = shutil.get_terminal_size()
    return {
        "executable": command.executable,
        "argv": command.argv,
        "env": command.env,
        "cwd": command.cwd,
        "umask": umask,
        "user": os.geteuid(),
        "group": os.getegid(),
        "groups": os.getgroups(),
        "stdin": streams.source,
        "stdout": streams.places[0],
        "stderr": streams.places[1],
        "rows_columns": (rows, columns),
        "hostname": socket.gethostname(),
        "busybox": str(busybox),
        "modules": modules,
        "interfaces": interfaces,
        "result": str(folder / "result.json"),
    }


def _modules(kernel: Path) -> list[str]:
    found = {file.name.split(".")[0]: file for file in kernel.glob("usr/lib/uml/modules/*/kernel/**/*.ko*")}
    missing = [name for name in MODULES if name not in found]
    if missing:
        raise CannotRunError(
            f"Debian's user-mode-linux of this release has no kernel module {missing[0]}: use another release"
        )
    return [str(found[name]) for name in MODULES]


def _build_xstate(library: Path) -> None:
    """Compile xstate.c, which lets the kernel run on processors with more registers than it was built for.

    Compiling takes milliseconds, so `library` is built in every run.
    """
    tcc = debian_packages.unpacked("tcc")
    runtime = tcc / "usr" / "lib" / f"{platform.machine()}-linux-gnu" / "tcc"
    source = Path(__file__).with_name("xstate.c")
    built = subprocess.run(
        [tcc / "usr/bin/tcc", f"-B{runtime}", "-nostdlib", "-shared", "-o", library, source],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if built.returncode != 0:
        raise CannotRunError(
            f"Debian's tcc could not compile {source} ({built.stderr.strip()}): remove {tcc}, so that tcc is fetched "
            "again, then try again"
        )


@contextmanager
def _job_folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="with-vcan-", dir=_roomy_folder(hidden_in_guest=False)) as name:
        yield Path(name)


def _roomy_folder(*, hidden_in_guest: bool) -> str:
    """Find a writable folder, not mounted noexec, for the guest's memory or for the files of a run.

    hidden_in_guest: True for the memory. It needs 1 GiB of room, and may be in the host's /dev/shm, which the guest
    cannot see. False for the files of a run, which the guest must see.
    Raises CannotRunError if there is no such folder.
    """
    candidates = [os.environ.get("TMPDIR", ""), "/dev/shm" if hidden_in_guest else "", "/tmp", "/var/tmp"]  # noqa: S108 - tried, not assumed
    for folder in candidates:
        if not folder.startswith("/") or len(folder.split()) != 1 or ":" in folder:
            continue  # such a name would fall apart on the kernel's command line and in LD_PRELOAD
        if not hidden_in_guest and folder.startswith(("/dev/", "/run/", "/proc/", "/sys/")):
            continue
        try:
            facts = os.statvfs(folder)
        except OSError:
            continue
        roomy = facts.f_bavail * facts.f_frsize >= (MEMORY_LEAST_FREE_BYTES if hidden_in_guest else 0)
        if roomy and not facts.f_flag & os.ST_NOEXEC and os.access(folder, os.W_OK | os.X_OK):
            return folder
    raise CannotRunError(
        "a user-mode Linux needs a folder with 1 GiB free that is not mounted noexec: set TMPDIR to such "
        "a folder, whose path has no spaces or colons"
    )


@contextmanager
def _booted(linux: Path, folder: Path, streams: Streams) -> Iterator["subprocess.Popen[bytes]"]:
    keys = "null" if streams.keyboard is None else f"fd:{streams.keyboard}"
    console = [] if streams.console is None else [f"con1={keys},fd:{streams.console}"]
    arguments = [
        f"mem={MEMORY_MIB}M",
        "rootfstype=hostfs",
        "rootflags=/",
        "rw",
        "con=null",
        "con0=null,fd:1",
        *console,
        # Measures RAID checksums for 0.8 s of a 1.3 s boot; nothing here has RAID 6.
        "initcall_blacklist=raid6_select_algo",
        "umid=guest",
        f"uml_dir={folder}/",
        f'init="{sys.executable}"',
        "--",
        "-I",
        "-S",
        f'"{guest.__file__}"',
        f"{folder}/job.json",
    ]
    _adopt_orphans()
    with (folder / "console").open("wb") as log:
        process = subprocess.Popen(
            [linux, *arguments],
            cwd=folder,
            env={"LD_PRELOAD": "./xstate.so", "TMPDIR": _roomy_folder(hidden_in_guest=True)},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            pass_fds=[end for end in (streams.keyboard, streams.console) if end is not None],
            start_new_session=True,
            preexec_fn=partial(die_with, os.getpid()),  # noqa: PLW1509 - this program has one thread
        )
    guard = _guard(process.pid)
    try:
        yield process
    finally:
        _kill_group(process)
        guard.kill()
        guard.communicate()


def _guard(group: int) -> "subprocess.Popen[bytes]":
    """Start a process that kills a process group as soon as this program has ended in any way.

    The process waits for the end of a pipe that only this program holds.
    """
    return subprocess.Popen(
        ["sh", "-c", _KILL_GROUP_AT_EOF, "sh", str(group)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _adopt_orphans() -> None:
    """Let this process reap the guest's orphans; the first process of a container perhaps does not reap them."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _kill_group(process: "subprocess.Popen[bytes]") -> None:
    """Kill all processes of the guest, which are processes of the host; no error if the guest has ended."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    with suppress(ChildProcessError):
        while True:
            os.waitpid(-process.pid, 0)  # the guest's orphans, which this process has adopted (_adopt_orphans)


def _exit_code(folder: Path) -> int:
    try:
        result: Result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CannotRunError(
            f"the user-mode Linux stopped before the command had ended; its last output:\n{_tail(folder)}"
        ) from None
    if "exit_code" in result:
        return result["exit_code"]
    raise CannotRunError(f"inside the user-mode Linux, {result['failure']}; its last output:\n{_tail(folder)}")


def _tail(folder: Path) -> str:
    lines = (folder / "console").read_text(errors="replace").splitlines()
    return "\n".join(f"    {line}" for line in lines[-TAIL_LINES:])
