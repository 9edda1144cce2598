"""One landing in real time: processes for the plant, for a manager and for an agent per PE, on software buses.

The aircraft is held in place until the first configuration runs and all control surfaces are driven. Faults are
injected at a time of the flight, or when the aircraft is below a height. A fault of a PE kills its process; a fault of
a device happens in the plant process; a fault of a bus happens in its hub. All processes end with the flight, however
the flight ends (`Fleet`).
"""

import json
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_manager.events import PlanReady
from heronry_tools.console.errors import UserError
from heronry_tools.fly.live.driver import FOLDER, READINGS
from heronry_tools.fly.live.shared_readings import Reader
from heronry_tools.fly.mission import Blow, Mission
from heronry_tools.fly.plant import NS_PER_S
from heronry_tools.fly.record import place_labels
from heronry_tools.runtime.demo.buses import choose, hub_paths
from heronry_tools.runtime.demo.event_stream import EventStream, LineStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.scenario.bad_radios import KINDS, BadRadios
from heronry_tools.sim.scenario.script import Deed

DRIVER = "flight"
_ROVER = ("rover", "vision")
_LONGEST_START_S = 60.0
_LOOK_S = 0.05
_NS_PER_MS = 1_000_000


def fly_live(spec: Spec, spec_file: Path, mission: Mission, record_file: Path | None = None) -> dict[str, Any]:
    """Fly a mission, and return the last JSON message of the plant process with one more field, `places`.

    `places` gives the place of each module in the last plan.

    record_file: where the plant process writes the record of the flight, as JSON
    Raises UserError if the mission has a fault that cannot be injected, or if a process fails or ends early.
    """
    unfit = [str(blow) for blow in mission.blows if blow.element.startswith("bus:")]
    if unfit:
        raise UserError(
            f"--kill {unfit[0]}: with --live only a PE or a device can be killed; write a bus fault with --act"
        )
    deeds = [_deed(act) for act in mission.acts]
    with ExitStack() as stack:
        folder = run_folder()
        fleet = stack.enter_context(Fleet(spec, spec_file, folder, simulator=DRIVER, environment={FOLDER: str(folder)}))
        plant = stack.enter_context(_Plant(folder, mission, record_file))
        choices = choose(spec, folder, {}, None, prefer_vcan=False)
        fleet.start_buses(choices)
        events = fleet.start_manager()
        for pe in spec.pes:
            if mission.has_rover or pe not in _ROVER:
                fleet.start_pe(pe)
        radios = stack.enter_context(BadRadios(deeds, hub_paths(choices)))
        return _Flight(fleet, plant, radios, mission, EventStream(events)).run()


def _deed(act: Fault) -> Deed:
    """Return a fault of a bus as a deed; raises UserError for other faults."""
    if act.kind not in KINDS or act.during:
        raise UserError(
            f"--act '{act}': with --live only these faults can be injected, and without 'in STATE': {', '.join(KINDS)}"
        )
    return Deed(0, act.at_ms * _NS_PER_MS, "fault", act.target, str(act), act)


class _Plant:
    """Starts the plant process, exchanges messages with it, and ends it."""

    def __init__(self, folder: Path, mission: Mission, record_file: Path | None) -> None:
        form = {
            "seed": mission.seed,
            "wind": mission.strongest_wind_m_per_s,
            "corrections_lost_s": mission.corrections_lost_s,
            "longest_s": mission.longest_s,
            "probed": mission.probed,
            "record": None if record_file is None else str(record_file.resolve()),
        }
        self._process = subprocess.Popen(
            [sys.executable, "-m", "heronry_tools.fly.live.plant_process", str(folder), json.dumps(form)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            process_group=0,
        )
        self._readings = folder / READINGS
        assert self._process.stdout is not None
        self._messages = LineStream(self._process.stdout)
        begun_s = time.monotonic()
        while not self._readings.exists():
            if self._process.poll() is not None or time.monotonic() - begun_s > _LONGEST_START_S:
                raise UserError("the plant process does not start; its message, if it wrote one, stands above")
            time.sleep(_LOOK_S)
        self._reader = Reader(self._readings)

    def __enter__(self) -> "_Plant":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    @property
    def height_m(self) -> float:
        """Return the present height of the wheels above the runway."""
        return self._reader.newest().height_m

    def fail(self, device: str, how: str) -> None:
        """Make a device of the plant fail; `how` is a `Failure`."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"fail": device, "how": how}).encode() + b"\n")
        self._process.stdin.flush()

    def said(self, wait_s: float) -> list[dict[str, Any]]:
        """Return the messages that the plant process sends within `wait_s`, perhaps none.

        Raises UserError if the process has ended.
        """
        messages = self._messages.take(wait_s)
        if self._messages.has_ended:
            raise UserError(
                "the plant process has ended during the flight; its message, if it wrote one, stands above; fly again"
            )
        return [json.loads(message) for message in messages]


class _Flight:
    """One flight, from the start of its processes to its end."""

    def __init__(self, fleet: Fleet, plant: _Plant, radios: BadRadios, mission: Mission, events: EventStream) -> None:
        self._fleet, self._plant, self._radios = fleet, plant, radios
        self._events = events
        self._places: dict[str, str] = {}  # of the modules in the newest plan
        self._due = list(mission.blows)
        self._released_ns: int | None = None

    def run(self) -> dict[str, Any]:
        """Run the flight to its end; return the last message of the plant process, with the field `places` added.

        `places` has the place of each module in the manager's newest plan. Raises UserError if a process reports a
        problem or ends too early, or if not every control surface is driven in time.
        """
        begun_s = time.monotonic()
        while True:
            for line in self._plant.said(_LOOK_S):
                if "problem" in line:
                    raise UserError(line["problem"])
                if "released_ns" not in line:
                    return {**line, "places": self._places}
                self._released_ns = line["released_ns"]
            for event in self._events.take():
                if isinstance(event, PlanReady):
                    self._places = place_labels(event.plan)
            problem = self._fleet.ended()
            if problem is None and self._released_ns is None and time.monotonic() - begun_s > _LONGEST_START_S:
                problem = f"not every control surface was driven within {_LONGEST_START_S:.0f} s of the start"
            if problem is not None:
                raise UserError(problem)
            self._inject_due()

    def _inject_due(self) -> None:
        if self._released_ns is None:
            return
        flown_ns = time.monotonic_ns() - self._released_ns
        self._radios.follow(flown_ns)
        flown_s = flown_ns / NS_PER_S
        for blow in list(self._due):
            if _is_due(blow, flown_s, self._plant.height_m):
                self._due.remove(blow)
                kind, _, name = blow.element.partition(":")
                if kind == "pe":
                    self._fleet.kill_pe(name)
                else:
                    self._plant.fail(name, blow.how)


def _is_due(blow: Blow, flown_s: float, height_m: float) -> bool:
    if blow.at_s is not None:
        return flown_s >= blow.at_s
    return blow.below_m is not None and height_m < blow.below_m
