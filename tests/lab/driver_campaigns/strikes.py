"""Strikes at the drivers of one PE: each ends as declared, and touches neither other devices nor any PE.

    python -m lab.driver_campaigns.strikes --number 500 [--seed 1]

    exit, segfault, raise, garbage   it is told, and the driver is started again; or the device is reported failed
    hang (in a read, in a write)     it is told, the process is ended, and then the same
    nan, far, nothing                the device is reported failed, and its process goes on
    flood, slow                      nothing is reported

Some devices are struck at the same time; the others must go on without a report. No PE may be lost, except beside a
told standstill of a computer.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

from lab.driver_campaigns.ends import CODE
from lab.driver_campaigns.flown import HEARTBEAT_MS, Flown, flown

SENSORS, SERVOS, AT_ONCE = 8, 4, 4
ENDS = {
    "exit": "ended with exit code 9",
    "segfault": "was killed by SIGSEGV",
    "raise": "ended with exit code 1",
    "garbage": "ended with exit code 1",
    "hang": "hangs, and is ended",
}
INVALID, HARMLESS = ("nan", "far", "nothing"), ("flood", "slow")
_OF_SENSORS, _OF_SERVOS = (*ENDS, *INVALID, *HARMLESS), ("exit", "segfault", "raise", "hang", *HARMLESS)
_QUIET_S = 0.5
MORE_CODE = """

class Reader(Module):
    def step(self, inputs):
        reading = self.ctx.read()
        return {} if reading is None else {"sum": reading}
"""


def document() -> dict[str, Any]:
    """Return the spec: all devices on one PE, and a function for each."""
    size = {"cpu": 4, "ram": "256KiB", "flash": "256KiB"}
    cost = {"cpu": 0.1, "ram": "1KiB", "rate_hz": 10, "partition": "all"}
    sensors, servos = [f"sensor_{i}" for i in range(SENSORS)], [f"servo_{i}" for i in range(SERVOS)]
    readers = {
        f"reader_{name[-1]}": {
            "image": "flown_code:Reader", "device": name, "gives": {f"read_{name[-1]}": 1}, **cost,
        }
        for name in sensors
    }  # fmt: skip
    movers = {
        f"mover_{name[-1]}": {"image": "flown_code:Servo", "device": name, "needs": "demand", **cost} for name in servos
    }
    ranges: dict[str, Any] = {"stale_ms": 1500, "range": [0, 100]}
    return {
        "dg": 1,
        "name": "strikes",
        "buses": {"can0": {"bitrate": 1_000_000, "heartbeat_ms": HEARTBEAT_MS}},
        "pes": {name: {"node_id": 92 + i, "buses": ["can0"], **size} for i, name in enumerate(("brain", "limbs"))},
        "devices": {name: {"kind": "sensor", "pe": "limbs", **ranges} for name in sensors}
        | {name: {"kind": "actuator", "pe": "limbs", "safe": 7} for name in servos},
        "variables": {"demand": {"type": "FLOAT"}} | {f"read_{i}": {"type": "FLOAT"} for i in range(SENSORS)},
        "modules": {"thinker": {"image": "flown_code:Demand", "runs_on": ["brain"], "gives": {"demand": 1}, **cost}}
        | readers
        | movers,
        "functions": {name: {"output": name, "criticality": "E"} for name in (*readers, *movers)},
    }


def code() -> str:
    """Return the code of the modules; each reader gives its own variable."""
    return CODE + MORE_CODE.replace('{"sum": reading}', '{"read_" + self.ctx.device[-1]: reading}')


class Strikes:
    """The rounds of one flight."""

    def __init__(self, flight: Flown, random: Random) -> None:
        self._flight, self._random = flight, random
        for pe in ("brain", "limbs"):
            flight.fleet.start_pe(pe)
        self._names = [*(f"sensor_{i}" for i in range(SENSORS)), *(f"servo_{i}" for i in range(SERVOS))]
        self.became: Counter[str] = Counter()
        self.failures: list[str] = []

    def begin(self) -> None:
        """Wait until every device works."""
        for name in self._names:
            self._until(f"{name} begins", lambda name=name: self._acts(name) > 0)

    def round(self, number: int) -> None:
        """Strike some devices at once, wait until each has ended as declared, and clear what was reported."""
        since, said = len(self._flight.events), self._flight.logged("limbs")
        struck = {
            name: self._random.choice(_OF_SENSORS if name.startswith("sensor") else _OF_SERVOS)
            for name in self._random.sample(self._names, number)
        }
        for name, order in struck.items():
            (self._flight.device(name) / "order").write_text(order)
        for name, order in struck.items():
            self._ends_as_declared(name, order, since, said)
        for name in struck:
            (self._flight.device(name) / "order").unlink(missing_ok=True)
        self._settle()
        harmed = {f"device:{name}" for name, order in struck.items() if order not in HARMLESS}
        unharmed = self._flight.told_without_standstill(since) - harmed
        if unharmed:
            self.failures.append(f"reported, though not harmed: {', '.join(sorted(unharmed))}; struck: {struck}")

    def _settle(self) -> None:
        """Clear what was reported, until nothing is reported any more and every device acts again.

        That of a driver that was given up takes more than 10 s.
        """
        quiet_s = time.monotonic()

        def is_quiet() -> bool:
            nonlocal quiet_s
            quiet_s = time.monotonic() if self._flight.told_anew() else quiet_s
            self._flight.clear()
            return time.monotonic() > quiet_s + _QUIET_S

        self._until("nothing more is reported", is_quiet)
        acts = {name: self._acts(name) for name in self._names}

        def idle() -> list[str]:
            self._flight.clear()
            return [name for name, before in acts.items() if self._acts(name) <= before]

        if not self._until("every device acts again", lambda: not idle()):
            self._tell_why(*idle())

    def _ends_as_declared(self, name: str, order: str, since: int, said: int) -> None:
        acts, element = self._acts(name), f"device:{name}"

        def goes_on() -> bool:
            self._flight.clear()  # a standstill of the computer may have had it reported
            return self._acts(name) > acts + 2

        if order in HARMLESS:
            if self._until(f"{name} goes on after {order}", goes_on):
                self.became[f"{order}: goes on"] += 1
            return
        sentence = f"the driver of device {name} {ENDS[order]}" if order in ENDS else ""

        def told() -> bool:
            if not sentence:
                return element in self._flight.told(since)
            self._flight.clear()  # a standstill may have had it reported before it was struck
            return sentence in self._flight.log("limbs", said)

        if self._until(f"{order} of {name} is told", told):
            given_up = "it is given up" in self._of(name, said)
            self.became[f"{order}: {'given up' if given_up else 'started again' if sentence else 'reported'}"] += 1

        else:
            self._tell_why(name)

    def _tell_why(self, *names: str) -> None:
        """Add to the last failure what the manager thinks of devices: if it clears one, that counted as failed."""
        said = [self._flight.clear_one(f"device:{name}") for name in names]
        logged = [line for name in names for line in self._of(name, 0).splitlines()[-6:]]
        self.failures[-1] += "\n  ".join([f": {', '.join(names)}; clearing them:", *said, "logged:", *logged])

    def _of(self, name: str, said: int) -> str:
        return "\n".join(line for line in self._flight.log("limbs", said).splitlines() if f"device {name} " in line)

    def _acts(self, name: str) -> int:
        file: Path = self._flight.device(name) / ("reads" if name.startswith("sensor") else "writes")
        return file.stat().st_size if file.exists() else 0

    def _until(self, what: str, is_so: Any) -> bool:
        if self._flight.until(what, is_so):
            return True
        self.failures.append(what)
        return False


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; returns the exit code."""
    parser = argparse.ArgumentParser(description="Strike drivers, and check what follows.")
    parser.add_argument("--number", type=int, default=500, metavar="N", help="strikes (default 500)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default 1")
    arguments = parser.parse_args(argv)
    with flown(document(), code()) as flight:
        strikes = Strikes(flight, Random(arguments.seed))
        strikes.begin()
        left = arguments.number
        while left > 0 and len(strikes.failures) < 10:
            strikes.round(min(AT_ONCE, left))
            left -= min(AT_ONCE, left)
            flight.progress(arguments.number - left, arguments.number, strikes.failures)
        lost = flight.lost_without_standstill(set())
        print(flight.counted())
    for what, times in sorted(strikes.became.items()):
        print(f"{times:6} {what}")
    for pe in lost:
        print(f"FAILURE: {pe} was lost without a told standstill")
    return 1 if strikes.failures or lost else 0


if __name__ == "__main__":
    sys.exit(main())
