"""The sending side of a simulated PE: gives frames to its controllers, with their age limits.

Each frame has an age limit, which is measured by the PE's own clock. The core may give a limit with the frame; without
one, the limit is `lease_ns`. The outbox also measures how long each frame to a radio took to leave (`took_ns`), and the
core is told this time. A fault can delay the frames that a gateway forwards (`delays`).
"""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.station import Station
from heronry_wire.frame import Frame
from heronry_wire.sansio import Send, StandBack, Withdraw


class PeOutbox:
    """The sending side of one PE, from its core to its controllers."""

    def __init__(
        self,
        clock: Clock,
        time: LocalClock,
        offers: Sequence[Callable[[Frame, int], None]],
        stations: Sequence[tuple[SimulatedBus, Station]],
        *,
        lease_ns: int,
        radios: frozenset[int],
    ) -> None:
        """Begin with nothing to send.

        clock: the virtual time of the flight; time: the clock of this PE
        offers: by port, a function that gives the controller a frame and the time until which it may be sent
        stations: each bus and channel of the PE, with the PE's simulated controller there
        lease_ns: age limit of a frame for which the core has given none
        radios: ports that lead to a radio
        """
        self._clock, self._time, self._lease_ns = clock, time, lease_ns
        self._offers, self._stations = offers, stations
        self.radios = radios
        self._handed_ns: dict[int, int] = {}  # by port of a radio: when the frame in its mailbox was passed
        self._withdrawn = Counter[int]()  # count of withdrawals by identifier
        self.delays: Callable[[], int] | None = None  # draws delays (ns) of forwarded frames (a fault)
        self.passing: Frame | None = None  # the frame just received, which the PE may forward

    def send(self, action: Send) -> None:
        """Give a frame to the controller of its port; if a fault delays forwarded frames, such a frame goes later."""
        port, frame, until_ns = action.port, action.frame, action.until_ns
        if port in self.radios:
            self._handed_ns[port] = self._time.now_ns()
        latest_ns = self._time.when_ns(self._time.now_ns() + self._lease_ns if until_ns is None else until_ns)
        if self.delays is None or frame is not self.passing:
            self._offers[port](frame, latest_ns)
        else:
            offer = partial(self._offer_late, port, frame, latest_ns, self._withdrawn[frame.can_id])
            self._clock.at(self._clock.now_ns + self.delays(), offer)

    def withdraw(self, action: Withdraw) -> None:
        """Drop all frames with the identifiers that `action` names, whether they wait or a fault delays them."""
        self._withdrawn.update(action.identifiers)
        for bus, station in self._stations:
            bus.withdraw(station, action.identifiers)

    def stand_back(self, action: StandBack) -> None:
        """Hold the data frames of a port back until the time that the action gives."""
        for bus, station in self._stations:
            if station.port == action.port:
                bus.stand_back(station, self._time.when_ns(action.until_ns))

    def took_ns(self, port: int) -> int | None:
        """Return the time in ns from `send` to now, for the frame that this port has just sent to a radio.

        Return None if `send` was not called for this port since the last call of this method.
        """
        handed_ns = self._handed_ns.pop(port, None)
        return None if handed_ns is None else self._time.now_ns() - handed_ns

    def _offer_late(self, port: int, frame: Frame, latest_ns: int, withdrawn: int) -> None:
        """Give a frame to the controller after its delay, unless it was withdrawn during the delay.

        latest_ns: the time until which the frame may be sent
        withdrawn: how often the identifier of the frame had been withdrawn when the delay began
        """
        if self._withdrawn[frame.can_id] == withdrawn:
            self._offers[port](frame, latest_ns)
