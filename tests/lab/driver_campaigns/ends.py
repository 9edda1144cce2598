"""Pauses and kills at random moments, of agents and of drivers: every actuator ends as declared.

    python -m lab.driver_campaigns.ends --number 100 [--seed 1]

A DEMUX has two branches, each with an actuator on a PE of its own. In each round the agent or the driver of the branch
that drives is paused or killed, or both are paused. Each write is told with its time, so that this can be said:

    agent paused       no command is written after the end of its validity (T_lease); then the register is safe
    agent killed       the same
    driver killed      it is told; the first write of its successor is the safe value
    driver paused      it is told if the pause is long; if it was ended, the first write of its successor is safe
    both paused        the driver goes on first: its first write is the safe value
    sluggish, retired  each write of the branch that drives takes 200 ms, and the operator retires its module
    always             a branch gets a command only after the safe value of the other one, also where they hand over
                       in order; but a driver that is paused or killed makes nothing safe
"""

import argparse
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from math import inf
from random import Random
from typing import Any

from heronry_manager.core.vocabulary import RestoreElement, RetireElement
from heronry_wire.protocol_times import LEASE_PERIODS
from lab.driver_campaigns.flown import HEARTBEAT_MS, Flown, flown
from lab.driver_campaigns.hardware import SLUGGISH, Written, register_of, writes_of

SAFE = "7"
_NS = 1_000_000_000
_LEASE_NS = LEASE_PERIODS * HEARTBEAT_MS * 1_000_000
_STOPS_NS = 30_000_000  # from the look at the clock to the effect of a signal, on a busy computer
WAYS = ("sluggish and retired", "agent paused", "agent killed", "driver paused", "driver killed", "both paused")
_PE = {"servo_a": "tail_a", "servo_b": "tail_b"}
CODE = """
from heronry_agent.module import Module


class Demand(Module):
    def __init__(self, ctx):
        super().__init__(ctx)
        self._steps = 0

    def step(self, inputs):
        self._steps += 1
        return {"demand": 50.0 + self._steps % 20}


class Servo(Module):
    def step(self, inputs):
        demand = inputs.get("demand")
        if demand is not None and demand.valid:
            self.ctx.write(demand.number())
        return {}
"""


def document() -> dict[str, Any]:
    """Return the spec."""
    size = {"cpu": 1, "ram": "64KiB", "flash": "64KiB"}
    cost = {"cpu": 0.1, "ram": "1KiB", "rate_hz": 20}
    pes = {name: {"node_id": 92 + i, "buses": ["can0"], **size} for i, name in enumerate(("brain", *_PE.values()))}
    servos = {
        f"mover_{name[-1]}": {"image": "flown_code:Servo", "device": name, "needs": "out", **cost} for name in _PE
    }
    return {
        "dg": 1,
        "name": "ends",
        "buses": {"can0": {"bitrate": 1_000_000, "heartbeat_ms": HEARTBEAT_MS}},
        "pes": pes,
        "devices": {name: {"kind": "actuator", "pe": pe, "safe": int(SAFE)} for name, pe in _PE.items()},
        "variables": {"demand": {"type": "FLOAT"}},
        "gates": {"out": {"demux": "demand"}},
        "modules": {"thinker": {"image": "flown_code:Demand", "runs_on": ["brain"], "gives": {"demand": 1}, **cost}}
        | servos,
        "functions": {"move": {"output": "out", "criticality": "A"}},
    }


class Ends:
    """The rounds of one flight."""

    def __init__(self, flight: Flown, random: Random) -> None:
        self._flight, self._random = flight, random
        self._agents = {pe: flight.fleet.start_pe(pe) for pe in ("brain", *_PE.values())}
        self._struck: set[str] = set()
        self._stopped: dict[int, float] = {}  # until when (ns) each driver that was paused or killed could do nothing
        self._judged_ns = 0  # all writes until then have been judged
        self.failures: list[str] = []

    def round(self, way: str) -> None:
        """Strike once, wait until all is as declared, and mend it."""
        flight = self._flight
        if not flight.until("a branch drives", self._is_mended):
            self.failures.append(f"{way}: no branch drives")
            return
        time.sleep(self._random.uniform(0.0, 0.3))
        servo = self._driving()
        if servo is None:
            return  # it is just being handed over
        pe, driver = _PE[servo], flight.drivers(self._agents[_PE[servo]]).get(servo)
        if driver not in {one.process for one in writes_of(flight.device(servo))}:
            return  # its process is just being started again, and has not even taken the first safe action
        self._struck.add(pe)
        agent, said = self._agents[pe], flight.logged(pe)
        known = {one.process for one in writes_of(flight.device(servo))}
        begun_ns = time.monotonic_ns()
        match way:
            case "agent paused":
                os.kill(agent, signal.SIGSTOP)
                self._expect_safe(servo, way, begun_ns)
                time.sleep(self._random.uniform(0.0, 0.5))
                self._expect_no_command(servo, way, begun_ns + _LEASE_NS + _STOPS_NS, time.monotonic_ns())
                os.kill(agent, signal.SIGCONT)
            case "agent killed":
                flight.fleet.kill_pe(pe)
                self._expect_safe(servo, way, begun_ns)
                self._expect_no_command(servo, way, begun_ns + _LEASE_NS + _STOPS_NS, time.monotonic_ns())
                self._agents[pe] = flight.fleet.start_pe(pe)
            case "driver killed":
                self._stopped[driver] = inf
                os.kill(driver, signal.SIGKILL)
                self._expect_successor(servo, way, known)
                self._expect_words(way, pe, said, "was killed by SIGKILL")
            case "driver paused":
                self._stop(driver)
                time.sleep(self._random.uniform(0.1, 1.5))
                self._go_on(driver)
                flight.look(0.2)
                if "hangs, and is ended" in flight.log(pe, said):
                    self._expect_successor(servo, way, known)
            case "sluggish and retired":
                (flight.device(servo) / "order").write_text(SLUGGISH)
                self._hand_over(servo, way)
                (flight.device(servo) / "order").unlink()
            case _:
                os.kill(agent, signal.SIGSTOP)
                self._stop(driver)
                time.sleep(2 * _LEASE_NS / _NS)
                expired_ns = time.monotonic_ns()
                self._go_on(driver)
                self._expect_safe(servo, way, begun_ns)
                os.kill(agent, signal.SIGCONT)
                late = [one for one in writes_of(flight.device(servo)) if one.at_ns > expired_ns]
                if late and late[0].value != SAFE:
                    self.failures.append(f"{way}: {late[0]} was the first write after the pause")
        self._expect_one_branch(way)

    def _hand_over(self, servo: str, way: str) -> None:
        flight, module, (other,) = self._flight, f"module:mover_{servo[-1]}", _PE.keys() - {servo}
        known = len(writes_of(flight.device(other)))

        def has_moved() -> bool:
            return any(one.value != SAFE for one in writes_of(flight.device(other))[known:])

        flight.fleet.order(RetireElement(module), module)
        if not flight.until(f"{way}: {other} drives", has_moved):
            self.failures.append(f"{way}: {other} does not drive")
        flight.fleet.order(RestoreElement(module), module)

    def _stop(self, driver: int) -> None:
        self._stopped[driver] = inf
        os.kill(driver, signal.SIGSTOP)

    def _go_on(self, driver: int) -> None:
        with suppress(ProcessLookupError):  # the agent has killed it meanwhile
            os.kill(driver, signal.SIGCONT)
            self._stopped[driver] = time.monotonic_ns() + _STOPS_NS

    def _is_mended(self) -> bool:
        self._flight.clear()
        return self._driving() is not None

    def _driving(self) -> str | None:
        found = [one for one in _PE if register_of(self._flight.device(one)) not in (SAFE, "", "0")]
        return found[0] if len(found) == 1 else None

    def _expect_safe(self, servo: str, way: str, begun_ns: int) -> None:
        folder = self._flight.device(servo)
        if not self._flight.until(f"{way}: {servo} is safe", lambda: register_of(folder) == SAFE):
            self.failures.append(f"{way}: {servo} did not become safe, {(time.monotonic_ns() - begun_ns) / _NS:.1f} s")

    def _expect_no_command(self, servo: str, way: str, from_ns: int, until_ns: int) -> None:
        for one in writes_of(self._flight.device(servo)):
            if from_ns < one.at_ns < until_ns and one.value != SAFE:
                self.failures.append(f"{way}: {one} was written {(one.at_ns - from_ns) / 1e6:.1f} ms too late")

    def _expect_successor(self, servo: str, way: str, known: set[int]) -> None:
        folder = self._flight.device(servo)

        def successor() -> list[str]:
            return [one.value for one in writes_of(folder) if one.process not in known]

        if not self._flight.until(f"{way}: a successor of {servo} writes", lambda: bool(successor())):
            self.failures.append(f"{way}: no successor of the driver of {servo} has written")
        elif successor()[0] != SAFE:
            self.failures.append(f"{way}: the successor's first write was {successor()[0]}")

    def _expect_words(self, way: str, pe: str, said: int, words: str) -> None:
        if not self._flight.until(f"{way}: '{words}' is told", lambda: words in self._flight.log(pe, said)):
            self.failures.append(f"{way}: {words} was not told")

    def _expect_one_branch(self, way: str) -> None:
        """Expect that no command went to a branch before the safe value went to the other one.

        Excused is the last command of a driver that was paused or killed: nobody can make its actuator safe.
        """
        writes = sorted((one, servo) for servo in _PE for one in writes_of(self._flight.device(servo)))
        last: dict[str, Written] = {}
        for one, servo in writes:
            for other in last.keys() - {servo}:
                before = last[other]
                is_excused = before.at_ns < self._stopped.get(before.process, 0)
                if one.at_ns > self._judged_ns and SAFE not in (one.value, before.value) and not is_excused:
                    self.failures.append(f"{way}: {servo} got a command before {other} was safe\n{_told(writes, one)}")
                    self._judged_ns = writes[-1][0].at_ns  # the same writes would be told again and again
            last[servo] = one
        self._judged_ns = writes[-1][0].at_ns

    def lost(self) -> list[str]:
        """Return the PEs that were lost without a reason."""
        return self._flight.lost_without_standstill(self._struck)


def _told(writes: Sequence[tuple[Written, str]], at: Written) -> str:
    """Return what was written around a write, each with its time from it in ms."""
    near = [(one, servo) for one, servo in writes if abs(one.at_ns - at.at_ns) < _NS]
    return "\n".join(
        f"  {(one.at_ns - at.at_ns) / 1e6:8.1f} {servo} {one.value} by {one.process}" for one, servo in near
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; returns the exit code."""
    parser = argparse.ArgumentParser(description="Pause and kill agents and drivers, and check how actuators end.")
    parser.add_argument("--number", type=int, default=100, metavar="N", help="rounds (default 100)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default 1")
    arguments = parser.parse_args(argv)
    random, counts = Random(arguments.seed), Counter[str]()
    with flown(document(), CODE) as flight:
        ends = Ends(flight, random)
        for number in range(arguments.number):
            way = WAYS[number % len(WAYS)]
            ends.round(way)
            counts[way] += 1
            flight.progress(number + 1, arguments.number, ends.failures)
        flight.look()
        lost = ends.lost()
        print(flight.counted())
    for way, times in counts.items():
        print(f"{times:6} {way}")
    for pe in lost:
        print(f"FAILURE: {pe} was lost without a strike or a told standstill")
    return 1 if ends.failures or lost else 0


if __name__ == "__main__":
    sys.exit(main())
