"""The acts of one flight: each strikes at its time, or in the state that it waits for, and is ended in time.

What was struck, and when, is kept for who judges the flight (`struck`). How each kind strikes is in `injection`.

Every act draws from a generator of its own, seeded by the run's seed and the act's text, so that leaving one act out of
a list changes nothing about the others: a failing list can be made shorter.
"""

from collections import Counter
from random import Random

from heronry_tools.sim.faults.fault import KINDS, WAITS_MS, Act, replicated_bus
from heronry_tools.sim.flight.injection.strike import End
from heronry_tools.sim.flight.injection.table import STRIKES
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Struck
from heronry_tools.sim.oracles.waivers import REPORTS, Waiver

_OF_ONE_ELEMENT = ("element", "pe", "gateway", "module", "device", "channel", "twin_pe")
_INTO_STATE_NS = (0, 100_000, 500_000, 2 * MS)


class Strikes:
    """Carries out the acts of one run; `hits` counts them by kind and by the state in which they struck."""

    def __init__(self, simulation: Simulation, acts: tuple[Act, ...], start_ns: int) -> None:
        """Schedule the acts, counted from `start_ns`."""
        self.hits: Counter[tuple[str, str]] = Counter()
        self.struck: list[Struck] = []
        self.state_of: dict[Act, str] = {}  # in which each act has struck
        self._simulation = simulation
        self._ends: dict[Act, End] = {}
        self._begun: dict[Act, int] = {}
        self._waivers: dict[Act, Waiver] = {}
        self._healed = False
        for act in acts:
            self._schedule(act, start_ns + act.at_ms * MS)

    def heal(self) -> None:
        """End whatever can be ended; nothing strikes any more."""
        self._healed = True
        for act in list(self._ends):
            self._end(act)
        self._simulation.operator.insist()

    def _schedule(self, act: Act, at_ns: int) -> None:
        simulation = self._simulation
        if not act.during:
            simulation.at(at_ns, lambda: self._strike(act))
            return
        self._wait(act, at_ns, self._random(act))
        simulation.at(at_ns + WAITS_MS * MS, lambda: self._strike(act))

    def _wait(self, act: Act, not_before_ns: int, random: Random) -> None:
        """Strike a moment after its state has begun; where that is over by then, the next time."""
        simulation = self._simulation

        def strike() -> None:
            if simulation.managers.protocol.now == act.during:
                self._strike(act)
            elif act not in self._begun:
                self._wait(act, simulation.now_ns, random)

        delay_ns = random.choice(_INTO_STATE_NS)
        simulation.managers.protocol.when(
            act.during, not_before_ns, lambda: simulation.at(simulation.now_ns + delay_ns, strike)
        )

    def _strike(self, act: Act) -> None:
        if self._healed or act in self._begun:
            return
        self._begun[act] = self._simulation.now_ns
        state = self._simulation.managers.protocol.now
        end = STRIKES[act.kind](self._simulation, act, self._random(act))
        if end is None:
            return
        self._simulation.managers.see_who_reigns()
        self.hits[act.kind, state] += 1
        self.state_of[act] = state
        self._waivers[act] = self._simulation.waivers.begin(self._unpromised(act), self._begun[act])
        if act.lasts_ms:
            self._ends[act] = end
            self._simulation.at(self._simulation.now_ns + act.lasts_ms * MS, lambda: self._end(act))
        else:
            self._note(act, None)

    def _end(self, act: Act) -> None:
        end = self._ends.pop(act, None)
        if end is not None:
            end()
            self._simulation.managers.see_who_reigns()
            self._note(act, self._simulation.now_ns)

    def _note(self, act: Act, to_ns: int | None) -> None:
        """Keep what was done for whoever judges the flight; a fault in an instant leaves nothing behind."""
        kind = KINDS[act.kind]
        of_one = kind.strikes in _OF_ONE_ELEMENT and not kind.excuses
        from_ns = self._begun[act]
        if to_ns is None and not kind.for_good:
            to_ns = from_ns
        if not kind.lasting:
            self._waivers[act].to_ns = to_ns
        self.struck.append(Struck(self._element(act) if of_one else None, from_ns, to_ns))

    def _unpromised(self, act: Act) -> frozenset[str]:
        """Rules that nobody can promise while an act is around."""
        kind = KINDS[act.kind]
        if kind.promised_with_key and self._simulation.key is not None:
            return frozenset()
        return kind.unpromised | ({REPORTS} if kind.excuses else frozenset())

    def _element(self, act: Act) -> str:
        """What is as good as down; who has one channel alone is as well served as everybody would be with that one."""
        bus = replicated_bus(self._simulation.spec, act.name) if KINDS[act.kind].strikes == "twin_pe" else None
        return act.target if bus is None else f"channel:{bus}.{act.level}"

    def _random(self, act: Act) -> Random:
        return Random(f"{self._simulation.seed} {act}")
