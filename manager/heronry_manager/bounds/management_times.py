"""The worst-case response times of management frames on each bus, in normal operation and during a reconfiguration.

These frames are counted:

    regular           the frames of semantics rule 9, the states that gateways forward to the manager, and page 1 with
                      every tenth state
    reconfiguration   once each (`Burst`): emergencies, PREPARE, SLICE, ACTIVATE, CONTROL, and the answers of each PE.
                      In every heartbeat period: a PING for each silent PE

Data and all other frames have lower priority; they delay a management frame by one frame of 8 bytes at most.

*SLICE frames.* The manager paces them: it sends one in the time that two would take (`core.epochs`). A bus that
cannot carry an endless stream at that pace may still carry the SLICE frames of one reconfiguration. So the analysis is
made twice, with a stream and with one burst, and the smaller result counts; both are upper bounds. Behind a gateway
SLICE frames may come in a burst.

*Assumptions.* A forwarded frame has a jitter of one of its periods. This holds if every response time is shorter than
the period, which the caller must check. No frame is lost or destroyed, and the nodes need no time to compute.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import ceil

from heronry_dg.model import Bus, Spec
from heronry_dg.situation import Situation, survivors
from heronry_manager.core.topology import uplink_bus
from heronry_wire.protocol_times import PATIENCE_PERIODS, STATE_PAGE_1_EVERY
from heronry_wire.timing import WORST_BLOCKING_BITS, Message, analyse

PACED_BITS = 2 * WORST_BLOCKING_BITS  # from one SLICE to the next
_NS_PER_S = 1_000_000_000
_LEASE_NEWS = 2  # LEASE and ALIVE that a gateway forwards immediately, since their content has changed


@dataclass(frozen=True, slots=True)
class Burst:
    """The management frames that a reconfiguration adds to the regular ones: how many frames of each kind.

    Each of these frames is sent once.
    """

    heads: int = 0  # SLICE frames on the manager's bus that are not paced
    paced: int = 0  # SLICE frames on the manager's bus that are paced
    slices_beyond: Mapping[str, int] = field(default_factory=dict)  # all SLICE frames, on each other bus
    broadcasts: int = 0  # PREPARE and ACTIVATE
    answers: int = 0  # of each PE
    reports: int = 0  # of modules: an emergency event, an EMCY, and the CONTROL that acknowledges it
    silent: frozenset[str] = frozenset()  # PEs that send nothing any more, and are PINGed with every beat


QUIET = Burst()


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """Longest response times on one bus, in nanoseconds: from when a frame is queued for this bus until its last bit.

    command_ns: response time of the manager's commands, and of CANaerospace emergency events.
    emergency_ns: response time of a CANopen EMCY.
    answer_ns: response time of a PE's state.
    """

    command_ns: int
    emergency_ns: int
    answer_ns: int


class ManagementTimes:
    """Computes the worst-case response times of the management frames on each bus of a spec."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        everything = survivors(spec, Situation())
        homes = [pe.name for pe in spec.pes.values() if spec.manager.bus in pe.buses]
        self.paths: dict[str, tuple[str, ...]] = {}  # buses from the manager to each PE that it can reach
        for pe in spec.pes.values():
            routes = [everything.route(home, pe.name) for home in homes]
            beyond = [route for route in routes if route is not None]
            if spec.manager.bus in pe.buses:
                self.paths[pe.name] = (spec.manager.bus,)
            elif beyond:
                shortest = min(beyond, key=len)
                self.paths[pe.name] = (spec.manager.bus, *(bus for bus in shortest if bus != spec.manager.bus))

    def on(self, bus: str, burst: Burst) -> FrameTimes | None:
        """Return the longest response times on `bus` when the frames of `burst` are added to the regular frames.

        None: the response times have no bound.

        On the manager's bus, the times are computed twice: with the SLICE frames as a paced stream, and with the SLICE
        frames as one burst. Both results are upper bounds. Of the two, the one with the shorter time for answers is
        returned.
        """
        entry = self._spec.buses[bus]
        ways = [
            self._frames(entry, burst, paced=paced) for paced in ([True, False] if self._is_first(bus) else [False])
        ]
        found = [times for times in (_times(entry, *way) for way in ways) if times is not None]
        return min(found, key=lambda times: times.answer_ns, default=None)

    def _is_first(self, bus: str) -> bool:
        return bus == self._spec.manager.bus

    def _frames(self, bus: Bus, burst: Burst, *, paced: bool) -> tuple[list[Message], int, int]:
        """List the frames on a bus that have priority over data, the most urgent first, with two counts.

        The list has three parts, in this order:

        1. CANaerospace emergency events and commands, which include the SLICE frames;
        2. CANopen EMCY frames;
        3. state frames and answers of PEs.

        The two counts are the lengths of parts 1 and 2.

        paced: treat the SLICE frames as an endless stream at their pace; otherwise as one burst.
        """
        period = Fraction(bus.heartbeat_ns * bus.bitrate, _NS_PER_S)
        senders = [
            pe
            for pe, path in self.paths.items()
            if pe not in burst.silent and (bus.name in path or bus.name in self._spec.pes[pe].buses)
        ]
        far = not self._is_first(bus.name)

        def once(count: int) -> list[Message]:
            return [_message(PATIENCE_PERIODS * period)] * count

        reports = once(burst.reports)
        commands = [*reports, *[_message(period, period / 4 if far else 0)] * 2]
        commands += once(_LEASE_NEWS * burst.broadcasts if far else 0) + once(burst.broadcasts)
        if far:
            commands += once(burst.slices_beyond.get(bus.name, 0))
        else:
            commands += once(burst.heads) + ([_message(Fraction(PACED_BITS))] if paced else once(burst.paced))
        commands += [_message(period)] * len(burst.silent) + once(burst.reports)
        states = [message for pe in senders for message in self._states(bus, pe)]
        return [*commands, *reports, *states, *once(burst.answers * len(senders))], len(commands), burst.reports

    def _states(self, bus: Bus, pe: str) -> tuple[Message, Message]:
        """Return page 0 and page 1 of a PE as periodic messages on this bus.

        If a gateway forwards the pages to this bus, both have a jitter of one heartbeat period of the PE.
        """
        home = bus if bus.name in self._spec.pes[pe].buses else self._spec.buses[uplink_bus(self._spec, pe)]
        period = Fraction(home.heartbeat_ns * bus.bitrate, _NS_PER_S)
        jitter = Fraction(0) if home is bus else period
        return _message(period, jitter), _message(STATE_PAGE_1_EVERY * period, jitter)


def _message(period: Fraction, jitter: Fraction | int = 0) -> Message:
    return Message("management", WORST_BLOCKING_BITS, period, jitter, period)


def _times(bus: Bus, frames: list[Message], commands: int, emergencies: int) -> FrameTimes | None:
    responses = analyse(frames, blocking_bits=WORST_BLOCKING_BITS)
    times = [
        None if response.bits is None else ceil((response.bits - frame.jitter) * _NS_PER_S / bus.bitrate)
        for response, frame in zip(responses, frames, strict=True)
    ]
    parts = (times[:commands], times[commands : commands + emergencies], times[commands + emergencies :])
    longest = [max((ns for ns in part if ns is not None), default=0) for part in parts]
    return None if None in times else FrameTimes(*longest)
