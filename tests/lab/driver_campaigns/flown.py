"""One aircraft whose devices are files, on a software bus, and what its manager and agents have told."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from heronry_dg.loader import load
from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement
from heronry_manager.shell.control_client import call
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder

PATIENCE_S = 60.0
HEARTBEAT_MS = 100
TESTS = Path(__file__).resolve().parents[2]
_CLEARS_S = 0.2
_BESIDE_NS = 3_000_000_000  # a standstill is told when it is over, and a loss after three heartbeats
_HARDWARE = "lab.driver_campaigns.hardware"


class Flown:
    """The processes, the folders of the devices, and all events so far."""

    def __init__(self, fleet: Fleet, stream: EventStream, folder: Path) -> None:
        self.fleet, self._stream, self._folder = fleet, stream, folder
        self.events: list[events.Event] = []
        self._clears_s = 0.0  # when `clear` may have an effect again
        self._cleared = 0  # number of the first event whose fault has not been cleared
        self._begun_s, self._told = time.monotonic(), 0  # the latter: failures that `progress` has printed

    def device(self, name: str) -> Path:
        """Return the folder of the files that stand for a device."""
        return self._folder / name

    def drivers(self, agent: int) -> dict[str, int]:
        """Return the processes of an agent's drivers, by name of the device."""
        found = {}
        for task in Path(f"/proc/{agent}/task").glob("*/children"):
            for child in task.read_text().split():
                words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
                if b"heronry_agent.shell.device_processes.driver_process" in words:
                    found[json.loads(words[-2])["device"]] = int(child)
        return found

    def log(self, pe: str, since: int = 0) -> str:
        """Return what an agent has said, from a byte of its log on."""
        with (self.fleet.folder / f"{pe}.log").open("rb") as log:
            log.seek(since)
            return log.read().decode(errors="replace")

    def logged(self, pe: str) -> int:
        """Return the number of bytes in the log of an agent."""
        return (self.fleet.folder / f"{pe}.log").stat().st_size

    def look(self, wait_s: float = 0.02) -> None:
        """Take the events that have come."""
        self.events += self._stream.take(wait_s)
        ended = self.fleet.ended()
        if ended is not None:
            raise RuntimeError(ended)

    def until(self, what: str, is_so: Callable[[], bool]) -> bool:
        """Look until something is so; returns False, and says so, if that takes too long."""
        end_s = time.monotonic() + PATIENCE_S
        while not is_so():
            if time.monotonic() > end_s:
                print(f"FAILURE: {what}: not within {PATIENCE_S:g} s")
                return False
            self.look()
        return True

    def told(self, since: int) -> set[str]:
        """Return the elements of which a fault was reported since an event, by its number."""
        return {one.element for one in self.events[since:] if isinstance(one, events.FaultReported)}

    def told_without_standstill(self, since: int) -> set[str]:
        """Return those of `told` beside which no standstill was told: a driver that stood still is late, too."""
        return {
            one.element
            for one in self.events[since:]
            if isinstance(one, events.FaultReported) and not self._is_beside_standstill(one)
        }

    def told_anew(self) -> set[str]:
        """Return the elements that were reported since `clear`."""
        return self.told(self._cleared)

    def clear(self) -> None:
        """Give the operator's order that whatever was reported, or is held down, works again.

        It may be reported once more. A PE that is lost again and again is held down for longer each time. Between two
        calls that have an effect is a moment: each order makes a new epoch, in which what does not work is reported.
        """
        if time.monotonic() < self._clears_s:
            return
        self._clears_s = time.monotonic() + _CLEARS_S
        held = {f"pe:{one.pe}" for one in self.events[self._cleared :] if isinstance(one, events.PeHeardAgain)}
        elements, self._cleared = self.told_anew() | held, len(self.events)
        for element in elements:
            self.clear_one(element)  # refused if it has come back meanwhile

    def clear_one(self, element: str) -> str:
        """Give the operator's order that an element works again; returns what the manager says."""
        return call(self.fleet.control_socket(), ClearElement(element)).sentence

    def lost_without_standstill(self, struck: set[str]) -> list[str]:
        """Return the PEs that were lost, were not struck, and beside whose loss no standstill was told."""
        return [
            one.pe
            for one in self.events
            if isinstance(one, events.PeLost) and one.pe not in struck and not self._is_beside_standstill(one)
        ]

    def _is_beside_standstill(self, event: events.Event) -> bool:
        stood = (one for one in self.events if isinstance(one, events.StoodStill))
        return any(abs(one.t_ns - event.t_ns) < _BESIDE_NS for one in stood)

    def progress(self, done: int, number: int, failures: list[str]) -> None:
        """Print how far a campaign has come, and what has failed since the last call."""
        took_s = time.monotonic() - self._begun_s
        print(f"{done:6} of {number} after {took_s:.0f} s; failures: {len(failures)}", flush=True)
        for failure in failures[self._told :]:
            print(f"FAILURE: {failure}", flush=True)
        self._told = len(failures)

    def counted(self) -> str:
        """Return how many PEs were lost, and how many standstills were told."""
        lost, stood = (sum(isinstance(one, kind) for one in self.events) for kind in (events.PeLost, events.StoodStill))
        return f"{lost:6} PEs lost, {stood} standstills of a computer told"


@contextmanager
def flown(document: Mapping[str, Any], code: str) -> Iterator[Flown]:
    """Fly a spec; every device has a folder, and the driver of its kind in `hardware`.

    code: the file `flown_code.py`, from which the images come.
    """
    with TemporaryDirectory(prefix="driver-campaign-") as name:
        folder = Path(name)
        (folder / "flown_code.py").write_text(code)
        devices = document["devices"]
        for device, said in devices.items():
            (folder / device).mkdir()
            (folder / device / "register").write_text("0")
            kind = "StruckSensor" if said["kind"] == "sensor" else "RecordedOutput"
            said |= {"driver": f"{_HARDWARE}:{kind}", "options": {"folder": str(folder / device)}}
        file = folder / "flown.dg.yaml"
        file.write_text(json.dumps(document))
        drivers = {one: {"driver": said["driver"], "options": said["options"]} for one, said in devices.items()}
        (folder / "devices.json").write_text(json.dumps(drivers))
        spec, path = load(file), {"PYTHONPATH": f"{TESTS}:{folder}"}
        with Fleet(spec, file, run_folder(), devices=folder / "devices.json", environment=path) as fleet:
            fleet.start_buses(choose(spec, fleet.folder, {}, None, prefer_vcan=False))
            yield Flown(fleet, EventStream(fleet.start_manager()), folder)
