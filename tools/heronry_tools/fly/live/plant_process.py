"""The plant process of a flight in real time: steps the EAV at 120 Hz, and serves its devices to all agents.

    python -m heronry_tools.fly.live.plant_process FOLDER MISSION

MISSION is a JSON object {"seed", "wind", "corrections_lost_s", "longest_s", "probed", "record"}.

The aircraft is held at its start until every surface has been driven for a second. Meanwhile the agents load the code
of their modules, which may take long on a busy computer. Surfaces, camera and the head of the camera already work, so
no monitor finds a fault. Inertial units and pitots read level flight at reference speed, without speed over ground and
without errors. With any other reading the control loops would integrate an error that they cannot reduce while the
aircraft is held. The aircraft would then begin its flight with the elevator far from its trim.

Standard output gets two JSON lines. The first is `{"released_ns": TIME}`, when the aircraft is released. The last one
has the touchdown and the longest standstill of the process; if the flight could not go on, it is `{"problem": REASON}`
instead. Standard input takes lines `{"fail": DEVICE, "how": HOW}`. When standard input is closed, the process ends.
"""

import json
import os
import select
import socket
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from heronry_agent.module import Value
from heronry_tools.aircraft.plant.interface import Failure
from heronry_tools.console.errors import UserError
from heronry_tools.console.whole_file import write_whole
from heronry_tools.fly.acceptance import causes
from heronry_tools.fly.avionics.control import REFERENCE_M_PER_S, trim_alpha_deg
from heronry_tools.fly.dynamics.eav import DEVICES, INERTIAL_UNITS, PITOTS
from heronry_tools.fly.dynamics.on_final import eav_on_final
from heronry_tools.fly.latency import LatencyProbe
from heronry_tools.fly.live.driver import COMMANDS, READINGS
from heronry_tools.fly.live.shared_readings import Snapshot, Writer
from heronry_tools.fly.mission import Mission
from heronry_tools.fly.plant import NS_PER_S, STEPS_PER_S
from heronry_tools.fly.record import Recorder

_STEP_NS = NS_PER_S // STEPS_PER_S
_ROLLS_S = 1.0
_SETTLES_NS = NS_PER_S
_SAMPLED_EVERY_S = 0.05
_STOOD_STILL_NS = 100_000_000
HELD: dict[str, Value] = {
    **dict.fromkeys(INERTIAL_UNITS, (0, 0, 0, 0, round(1000.0 * trim_alpha_deg(REFERENCE_M_PER_S)), 0, 0, 0)),
    **dict.fromkeys(PITOTS, REFERENCE_M_PER_S),
}


class PlantProcess:
    """The plant with its clock, its shared readings and its socket for commands."""

    def __init__(self, folder: Path, mission: Mission, record_file: Path | None) -> None:
        self._mission, self._record_file = mission, record_file
        self._recorder = Recorder("eav", "in real time", mission.seed)
        self._probe = LatencyProbe() if mission.probed else None
        self._plant = eav_on_final(mission, self._recorder, self._probe, held=True)
        self._clock_ns = time.monotonic_ns()  # when the plant's time began
        self._origin_ns: int | None = None  # when the aircraft was released
        self._driven: dict[str, int] = {}  # by surface: when it was driven first
        self._sampled_s = 0.0
        self._latest_ns = 0  # longest time between two rounds
        self._commands = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._commands.bind(str(folder / COMMANDS))
        self._writer = Writer(folder / READINGS)

    def run(self) -> None:
        """Fly until a second after the touchdown, until the longest time is over, or until standard input is closed."""
        due_ns = before_ns = time.monotonic_ns()
        while not self._is_over():
            now_ns = time.monotonic_ns()
            if self._origin_ns is not None:
                self._latest_ns = max(self._latest_ns, now_ns - before_ns)
            before_ns = now_ns
            self._take_commands(now_ns)
            self._release_when_all_is_driven(now_ns)
            self._publish(now_ns)
            due_ns = max(due_ns + _STEP_NS, now_ns)
            if not self._wait_until(due_ns):
                return
        if self._record_file is not None:
            write_whole(self._record_file, self._recorder.finished().as_json().encode())
        _say(self._result())

    def _plant_ns(self, now_ns: int) -> int:
        return now_ns - self._clock_ns

    def _flown_ns(self, now_ns: int) -> int:
        return 0 if self._origin_ns is None else now_ns - self._origin_ns

    def _is_over(self) -> bool:
        flown_s = self._flown_ns(time.monotonic_ns()) / NS_PER_S
        landed = self._recorder.touchdown
        return flown_s > self._mission.longest_s or (landed is not None and flown_s > landed.time_s + _ROLLS_S)

    def _release_when_all_is_driven(self, now_ns: int) -> None:
        if self._origin_ns is not None or len(self._driven) < len(self._plant.servos.surfaces):
            return
        if now_ns > max(self._driven.values()) + _SETTLES_NS:
            self._origin_ns = now_ns
            self._plant.release(self._plant_ns(now_ns))
            _say({"released_ns": now_ns})

    def _take_commands(self, now_ns: int) -> None:
        while True:
            try:
                device, value = json.loads(self._commands.recv(4096))
            except BlockingIOError:
                return
            if self._origin_ns is None and device in self._plant.servos.pushes:
                self._driven.setdefault(self._plant.servos.pushes[device], now_ns)
            self._plant.write(device, tuple(value) if isinstance(value, list) else value, self._plant_ns(now_ns))

    def _publish(self, now_ns: int) -> None:
        plant_ns = self._plant_ns(now_ns)
        self._plant.advance(plant_ns)
        truth = self._plant.truth()
        if self._origin_ns is not None and truth.time_s >= self._sampled_s + _SAMPLED_EVERY_S:
            self._sampled_s = truth.time_s
            surfaces = self._plant.servos.surfaces
            columns = {f"{name}_deg": surfaces[name].position for name in ("elevator", "aileron", "rudder")}
            self._recorder.sample(truth, {**columns, "throttle": surfaces["throttle"].position})
        readings = {device: self._plant.read(device, plant_ns) for device in (*DEVICES, *self._plant.servos.pushes)}
        if self._origin_ns is None:
            readings |= HELD
        refusing = frozenset(name for name, (how, _) in self._plant.servos.failed.items() if how in ("dead", "stuck"))
        self._writer.write(Snapshot(now_ns, truth.height_m, readings, refusing))

    def _wait_until(self, due_ns: int) -> bool:
        """Wait until `due_ns`, and meanwhile make devices fail as lines on standard input request.

        Return False if standard input is closed.
        """
        while True:
            left_s = (due_ns - time.monotonic_ns()) / NS_PER_S
            ready, _, _ = select.select([0], [], [], max(left_s, 0.0))
            if not ready:
                return True
            line = os.read(0, 65536)
            if not line:
                return False
            for order in map(json.loads, line.splitlines()):
                now_ns = time.monotonic_ns()
                self._plant.fail(order["fail"], cast("Failure", order["how"]), self._plant_ns(now_ns))

    def _result(self) -> dict[str, Any]:
        landed = self._recorder.touchdown
        return {
            "seed": self._mission.seed,
            "acceptable": not causes(landed),
            "causes": list(causes(landed)),
            "touchdown": None if landed is None else asdict(landed),
            "longest_standstill_ms": round(self._latest_ns / 1e6, 1),
            "latencies_ns": [] if self._probe is None else self._probe.latencies_ns,
            "stood_still": self._latest_ns > _STOOD_STILL_NS,
        }


def _say(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


def main() -> None:
    """Fly the mission that the command line gives; a UserError is written to standard output as `problem`."""
    form = json.loads(sys.argv[2])
    mission = Mission(
        seed=form["seed"],
        strongest_wind_m_per_s=form["wind"],
        corrections_lost_s=form["corrections_lost_s"],
        longest_s=form["longest_s"],
        probed=form["probed"],
    )
    record_file = None if form["record"] is None else Path(form["record"])
    process = PlantProcess(Path(sys.argv[1]), mission, record_file)
    try:
        process.run()
    except UserError as problem:
        _say({"problem": str(problem)})


if __name__ == "__main__":
    main()
