"""Injects the faults of one flight: when each fault begins, and when it ends.

A fault begins at its time, unless it waits for a state of the protocol. Then it begins shortly after the protocol has
entered that state, but no later than WAITS_MS after its time. It ends after its duration. The functions that inject
each kind of fault are in the other files of this folder. The oracles read from `injected` what was injected, and when.

Each fault has its own random generator. The seed of this generator consists of the flight's seed and the text of the
fault. So removing one fault from a list does not change the others, and `shrink` can shorten a list that makes a flight
fail.
"""

from collections import Counter
from random import Random

from heronry_tools.sim.faults.fault import KINDS, WAITS_MS, Fault, replicated_bus
from heronry_tools.sim.flight.injection.inject import End
from heronry_tools.sim.flight.injection.table import INJECTIONS_BY_KIND
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Injected
from heronry_tools.sim.oracles.waivers import REPORTS, Waiver

_OF_ONE_ELEMENT = ("element", "pe", "gateway", "module", "device", "channel", "twin_pe")
_INTO_STATE_NS = (0, 100_000, 500_000, 2 * MS)


class Injections:
    """Injects the faults of one flight; `hits` counts the injections by kind and by the state of the protocol."""

    def __init__(self, simulation: Simulation, faults: tuple[Fault, ...], start_ns: int) -> None:
        """Schedule the faults, with times counted from `start_ns`."""
        self.hits: Counter[tuple[str, str]] = Counter()
        self.injected: list[Injected] = []
        self.state_of: dict[Fault, str] = {}  # the state in which each fault was injected
        self._simulation = simulation
        self._ends: dict[Fault, End] = {}
        self._begun: dict[Fault, int] = {}
        self._waivers: dict[Fault, Waiver] = {}
        self._healed = False
        for fault in faults:
            self._schedule(fault, start_ns + fault.at_ms * MS)

    def heal(self) -> None:
        """End every fault that can be ended, and inject no further fault.

        From now on the operator repeats orders that a new active manager may not know (`insist`).
        """
        self._healed = True
        for fault in list(self._ends):
            self._end(fault)
        self._simulation.operator.insist()

    def _schedule(self, fault: Fault, at_ns: int) -> None:
        simulation = self._simulation
        if not fault.during:
            simulation.at(at_ns, lambda: self._inject(fault))
            return
        self._wait(fault, at_ns, self._random(fault))
        simulation.at(at_ns + WAITS_MS * MS, lambda: self._inject(fault))

    def _wait(self, fault: Fault, not_before_ns: int, random: Random) -> None:
        """Inject a fault shortly after the protocol has entered the state for which the fault waits.

        The wait begins at `not_before_ns`. If the protocol has left the state before the fault is injected, wait
        until the protocol enters the state again.
        """
        simulation = self._simulation

        def inject() -> None:
            if simulation.managers.protocol.now == fault.during:
                self._inject(fault)
            elif fault not in self._begun:
                self._wait(fault, simulation.now_ns, random)

        delay_ns = random.choice(_INTO_STATE_NS)
        simulation.managers.protocol.when(
            fault.during, not_before_ns, lambda: simulation.at(simulation.now_ns + delay_ns, inject)
        )

    def _inject(self, fault: Fault) -> None:
        if self._healed or fault in self._begun:
            return
        self._begun[fault] = self._simulation.now_ns
        state = self._simulation.managers.protocol.now
        end = INJECTIONS_BY_KIND[fault.kind](self._simulation, fault, self._random(fault))
        if end is None:
            return
        self._simulation.managers.see_active_manager()
        self.hits[fault.kind, state] += 1
        self.state_of[fault] = state
        self._waivers[fault] = self._simulation.waivers.begin(self._unpromised(fault), self._begun[fault])
        if fault.lasts_ms:
            self._ends[fault] = end
            self._simulation.at(self._simulation.now_ns + fault.lasts_ms * MS, lambda: self._end(fault))
        else:
            self._note(fault, None)

    def _end(self, fault: Fault) -> None:
        end = self._ends.pop(fault, None)
        if end is not None:
            end()
            self._simulation.managers.see_active_manager()
            self._note(fault, self._simulation.now_ns)

    def _note(self, fault: Fault, to_ns: int | None) -> None:
        """Record a fault for the oracles, and set the end of its waiver.

        to_ns: when the fault was ended; None if it takes no time or does not end
        """
        kind = KINDS[fault.kind]
        of_one = kind.target_kind in _OF_ONE_ELEMENT and not kind.excuses
        from_ns = self._begun[fault]
        if to_ns is None and not kind.for_good:
            to_ns = from_ns
        if not kind.lasting:
            self._waivers[fault].to_ns = to_ns
        self.injected.append(Injected(self._element(fault) if of_one else None, from_ns, to_ns))

    def _unpromised(self, fault: Fault) -> frozenset[str]:
        """Return the rules of the oracles that are waived while a fault is present."""
        kind = KINDS[fault.kind]
        if kind.promised_with_key and self._simulation.key is not None:
            return frozenset()
        return kind.unpromised | ({REPORTS} if kind.excuses else frozenset())

    def _element(self, fault: Fault) -> str:
        """Return the element that counts as down during a fault."""
        bus = replicated_bus(self._simulation.spec, fault.name) if KINDS[fault.kind].target_kind == "twin_pe" else None
        # of a replicated bus, a PE loses one channel
        return fault.target if bus is None else f"channel:{bus}.{fault.level}"

    def _random(self, fault: Fault) -> Random:
        return Random(f"{self._simulation.seed} {fault}")
