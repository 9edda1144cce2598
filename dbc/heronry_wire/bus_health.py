"""Link status events of one bus of one node, as sentences and counts: lost, back, bus-off, passive, stuck, overrun.

    on the bus   the bus can be used. There is no event as long as all is well. There is an event when the controller
                 counts errors, or when no frame leaves; the same event comes again after TELL_AGAIN_NS at the earliest,
                 so that an intermittent error does not fill the log
    off the bus  since `off_since_ns` the bus cannot be used; there is an event whenever the reason changes

The driver of a node reads `off_since_ns` and decides what to do about an outage. An error frame describes this node's
own controller, and no other node. A doubled error frame changes only a count. If the error frame that reports bus-off
is lost, the bus is reported as stuck.
"""

from collections import Counter

from heronry_wire.controller import ControllerReport, ControllerState

TELL_AGAIN_NS = 10_000_000_000
_NS_PER_S = 1_000_000_000
_BAD = {
    ControllerState.ERROR_WARNING: "counts errors (error-warning)",
    ControllerState.ERROR_PASSIVE: "sees mostly errors (error-passive): look at its bit rate, termination and wiring",
}
_STUCK = "gets nothing out: no other node acknowledges; look at bit rate, termination and wiring"


class BusHealth:
    """Keeps for one bus whether the bus can be used, its error counts, and its link status events."""

    def __init__(self, name: str) -> None:
        """name: the name of the bus in messages."""
        self.name = name
        self.off_since_ns: int | None = None  # None: on the bus
        self.counts: Counter[str] = Counter()
        self.reason = ""  # why the bus is, or was last, off
        self._link_events: list[str] = []
        self._told_ns: dict[str, int] = {}

    @property
    def has_link_events(self) -> bool:
        """Tell whether `take_link_events` has something to give."""
        return bool(self._link_events)

    def take_link_events(self) -> list[str]:
        """Return the link status events since the last call, each as a sentence."""
        link_events, self._link_events = self._link_events, []
        return link_events

    def lost(self, now_ns: int, reason: str) -> None:
        """Note that the bus is lost; makes an event if the bus was not lost before, or was lost for another reason.

        The caller repeats the call after every failed try to open the bus, with the reason of the failure.
        """
        if self.off_since_ns is None:
            self.off_since_ns = now_ns
            self.counts["lost"] += 1
            self.reason = ""
        if reason != self.reason:
            self.reason = reason
            self._link_events.append(f"{self.name} is lost: {reason}; it is tried again until it is back")

    def back(self, now_ns: int) -> None:
        """Note that the bus can be used again; if the bus was lost, make a link status event."""
        if self.off_since_ns is not None:
            seconds = (now_ns - self.off_since_ns) / _NS_PER_S
            self._link_events.append(f"{self.name} is back after {seconds:.1f} s")
            self.off_since_ns = None

    def reported(self, report: ControllerReport, now_ns: int) -> None:
        """Count each error and the state of the controller, as far as an error frame has named them.

        Makes a link status event if the state is one of `_BAD`.
        """
        self.counts.update(report.kinds)
        if report.state is not None:
            self.counts[report.state.name.lower().replace("_", "-")] += 1
        if report.state in _BAD:
            self._tell(_BAD[report.state], now_ns)

    def stuck(self, now_ns: int) -> None:
        """Make an event which says that this node has sent no frame during the last `link.STUCK_NS`."""
        self._tell(_STUCK, now_ns)

    def overrun(self, frames: int, now_ns: int) -> None:
        """Count frames that were lost because this process read too late; makes an event if `frames` is above 0."""
        if frames:
            self.counts["frames not taken in time"] += frames
            self._tell("brings more frames than this computer takes: some are lost", now_ns)

    def _tell(self, what: str, now_ns: int) -> None:
        if now_ns - self._told_ns.get(what, -TELL_AGAIN_NS) >= TELL_AGAIN_NS:
            self._told_ns[what] = now_ns
            self._link_events.append(f"{self.name} {what}")
