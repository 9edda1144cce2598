"""The processes of an aircraft on one bus: a test starts them, hears what they say, and ends them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from heronry_tools.runtime.softbus.starter import start_hub

PATIENCE_S = 60


class Nodes:
    """The processes on one bus; what a process says on standard error is in its log, NAME.log."""

    def __init__(self, bus: Path | str, folder: Path, *more: str) -> None:
        """Begin without processes; `bus`: the socket of a software bus, or the name of a SocketCAN interface.

        more: words for the command of each process.
        """
        interface = "softbus" if isinstance(bus, Path) else "socketcan"
        self.folder, self.bus, self.more = folder, ["-i", interface, "-c", str(bus)], more
        self.socket = folder / "manager.sock"
        self.running: list[subprocess.Popen[str]] = []

    def start(self, name: str, *words: str, code: str = "") -> "subprocess.Popen[str]":
        """Start a process of Python with these words; `code`: folder of modules that only it can import."""
        environment = {**os.environ, "PYTHONPATH": code, "XDG_STATE_HOME": str(self.folder)}
        with (self.folder / f"{name}.log").open("a") as log:
            self.running.append(
                subprocess.Popen(
                    [sys.executable, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True,
                    env=environment,
                )
            )  # fmt: skip
        return self.running[-1]

    def agent(self, name: str, *words: str, code: str = "") -> "subprocess.Popen[str]":
        """Start an agent."""
        return self.start(name, "-m", "heronry_agent", *words, *self.bus, *self.more, "--until-eof", code=code)

    def manager(self, spec: str, *words: str, code: str = "") -> Iterable[str]:
        """Start the manager; returns the lines with its events."""
        manager = self.start(
            "manager", "-m", "heronry_tools.cli", "manager", spec, "--json", "--contingencies", "none",
            "--state-dir", str(self.folder), "--socket", str(self.socket), *self.bus, *self.more, *words,
            "--until-eof", code=code,
        )  # fmt: skip
        assert manager.stdout is not None
        return manager.stdout

    def said(self, name: str) -> str:
        """Return what the processes of this name have said so far."""
        return (self.folder / f"{name}.log").read_text()

    def wait(self, name: str, text: str, times: int = 1) -> str:
        """Wait until the processes of this name have said something so many times; returns all that they have said."""
        end_s = time.monotonic() + PATIENCE_S
        while self.said(name).count(text) < times:
            assert time.monotonic() < end_s, self.said(name)
            time.sleep(0.05)
        return self.said(name)

    def end(self) -> None:
        """End all processes."""
        for process in self.running:
            process.send_signal(signal.SIGTERM)
        for process in self.running:
            process.communicate(timeout=PATIENCE_S)
        self.running.clear()


N = TypeVar("N", bound=Nodes)


@contextmanager
def ended(nodes: N) -> Iterator[N]:
    """End the processes with the context."""
    try:
        yield nodes
    finally:
        nodes.end()


@contextmanager
def nodes_on_a_bus(folder: Path, kind: type[N]) -> Iterator[N]:
    """Open a software bus on which there are no processes yet."""
    with start_hub(folder / "can0.sock", 1_000_000) as hub, ended(kind(hub.path, folder)) as nodes:
        yield nodes
