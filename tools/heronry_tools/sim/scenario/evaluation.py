"""Evaluates the expectations of a scenario by the frames that were heard, and says what was heard instead.

There are three kinds of expectations:

    something is sent or has a state    holds since the first frame of a *chain*: an unbroken series of frames that
                                        agree with the expectation, and that lasts until the time of the expectation
                                        ends
    a PE reports something              holds since the first frame with this report
    silent, unchanged, not reported     holds after the last frame that contradicts the expectation

A chain is broken by a frame that contradicts the expectation, and by a gap that is longer than in this list:

    outputs     two and a half periods of the slowest mode that makes them, so that one output may be missing
    data        two and a half periods of the slowest mode that gives them
    states      the heartbeat periods that a PE may miss on its bus, and one more
    LEASE       the time after which a PE considers its manager lost

Real processes share a computer with other programs, so these times are longer for real processes (`slack_ns`).
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_dg.echo_rates import EchoRates
from heronry_dg.model import Spec
from heronry_dg.situation import module_of
from heronry_manager.core.topology import uplink_bus
from heronry_tools.sim.scenario.observations import Observations
from heronry_tools.sim.scenario.script import Expectation
from heronry_wire.management import NO_EPOCH
from heronry_wire.protocol_times import heard_ns, t_lease_ns
from heronry_wire.state_frames import PeState

Mark = tuple[int, bool]
"""When a frame was heard (ns), and whether it agrees with the expectation."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result for one expectation: whether it holds, and in `seen` a sentence on what was heard."""

    expectation: Expectation
    holds: bool
    seen: str


class Evaluation:
    """Evaluates the expectations of one flight."""

    def __init__(self, spec: Spec, heard: Observations, start_ns: int, slack_ns: int = 0) -> None:
        """Begin an evaluation, which uses only the frames in `heard`.

        start_ns: time at which the script began
        slack_ns: added to the longest allowed gap between frames
        """
        self._spec, self._heard, self._start_ns, self._slack_ns = spec, heard, start_ns, slack_ns
        self._rates = EchoRates(spec)

    def verdict(self, one: Expectation) -> Verdict:
        """Return whether an expectation holds, with a sentence on what was heard."""
        if one.state in ("silent", "unchanged") or one.subject == "nothing":
            last_ns = self._last_against(one)
            within = last_ns is None or last_ns <= self._ns(one.from_ns + one.within_ns)
            return Verdict(one, within, self._silence(one, last_ns))
        since_ns = self._since(one)
        within = since_ns is not None and since_ns <= self._ns(one.from_ns + one.within_ns)
        return Verdict(one, within, self._seen(one, since_ns))

    # What holds since when

    def _since(self, one: Expectation) -> int | None:
        kind, _, name = one.subject.partition(":")
        marks, patience_ns = self._marks(one, kind, name)
        until_ns = self._ns(one.until_ns)
        if patience_ns is None:  # one frame is enough
            from_ns = self._ns(one.from_ns)
            return next((t for t, says in marks if says and from_ns <= t <= until_ns), None)
        return holds_since(marks, patience_ns + self._slack_ns, until_ns)

    def _marks(self, one: Expectation, kind: str, name: str) -> tuple[list[Mark], int | None]:
        heard = self._heard
        match kind:
            case "function":
                outputs = self._spec.functions[name].outputs
                told = [(o.t_ns, one.by in (None, o.module)) for o in heard.outputs if o.module in outputs]
                return told, self._usual_gap_ns(name)
            case "variable":
                return [(t, True) for t, variable in heard.data if variable == name], self._usual_pause_ns(name)
            case "pe" if one.state != "reported":
                state = PeState[one.state.upper()]
                told = [(s.t_ns, s.page.state is state) for s in heard.states if s.pe == name]
                return told, self._missed_ns(name)
            case "manager":
                return [(t, True) for t in heard.leases], t_lease_ns(self._beat_ns())
            case "epoch":
                old = self._epoch_at(one.from_ns)
                active = [s for s in heard.states if s.page.epoch != NO_EPOCH]
                return [(s.t_ns, s.page.epoch != old) for s in active], max(map(self._missed_ns, self._spec.pes))
            case _:
                return [(t, one.subject in (element, module_of(element))) for t, element in heard.reports], None

    def _last_against(self, one: Expectation) -> int | None:
        """Return the time of the last frame that contradicts an expectation of silence, of no change or of no report.

        Only frames within the time of the expectation count. Silence is contradicted by every frame of the subject,
        `epoch unchanged` by every state that names another epoch than the one at the beginning of this time, and
        `nothing reported` by every report. None: no frame contradicts the expectation.
        """
        kind, _, name = one.subject.partition(":")
        heard = self._heard
        match kind:
            case "function":
                outputs = self._spec.functions[name].outputs
                times = [o.t_ns for o in heard.outputs if o.module in outputs]
            case "variable":
                times = [t for t, variable in heard.data if variable == name]
            case "pe":
                times = [s.t_ns for s in heard.states if s.pe == name]
            case "manager":
                times = heard.leases
            case "epoch":
                old = self._epoch_at(one.from_ns)
                times = [s.t_ns for s in heard.states if s.page.epoch not in (NO_EPOCH, old)]
            case _:
                times = [t for t, _ in heard.reports]
        return max((t for t in times if self._ns(one.from_ns) < t <= self._ns(one.until_ns)), default=None)

    def _epoch_at(self, from_ns: int) -> int:
        """Return the epoch that the last state heard by a time of the script names, of whichever PE; or NO_EPOCH."""
        named = [(s.t_ns, s.page.epoch) for s in self._heard.states if s.page.epoch != NO_EPOCH]
        before = [epoch for t, epoch in named if t <= self._ns(from_ns)]
        # if all were heard later, the first of them counts
        return before[-1] if before else next((epoch for _, epoch in named), NO_EPOCH)

    def _usual_gap_ns(self, function: str) -> int:
        return _patience_ns(self._rates.longest_gap_ns(self._spec.functions[function].outputs))

    def _usual_pause_ns(self, variable: str) -> int:
        modes = (mode for module in self._spec.modules.values() for mode in module.modes.values())
        return _patience_ns(max(10**12 // mode.rate_mhz for mode in modes if variable in mode.gives))

    def _missed_ns(self, pe: str) -> int:
        bus = self._spec.buses[uplink_bus(self._spec, pe)]
        return heard_ns(bus.heartbeat_ns, bus.misses)

    def _beat_ns(self) -> int:
        return self._spec.buses[self._spec.manager.bus].heartbeat_ns

    def _ns(self, script_ns: int) -> int:
        return self._start_ns + script_ns

    # What was seen, in words

    def _seen(self, one: Expectation, since_ns: int | None) -> str:
        if since_ns is not None:
            if since_ns <= self._ns(one.from_ns):
                return "this held all the time"
            return f"this held from {self._s(since_ns)} on, {self._after(one, since_ns)}"
        if one.state == "reported":
            return f"no PE reported that up to {self._s(self._ns(one.until_ns))}"
        told = self._last_words(one)
        return f"this did not hold at {self._s(self._ns(one.until_ns))}; the last heard was {told or 'nothing'}"

    def _last_words(self, one: Expectation) -> str | None:
        """Return a phrase that says what was heard last of an expectation's subject, and when.

        Only frames up to the end of the expectation's time count. None: nothing was heard.
        """
        kind, _, name = one.subject.partition(":")
        heard, until_ns = self._heard, self._ns(one.until_ns)
        match kind:
            case "function":
                outputs = self._spec.functions[name].outputs
                told = [(o.t_ns, o.module) for o in heard.outputs if o.module in outputs]
            case "variable":
                told = [(t, variable) for t, variable in heard.data if variable == name]
            case "pe":
                told = [(s.t_ns, s.page.state.name.lower()) for s in heard.states if s.pe == name]
            case "epoch":
                told = [(s.t_ns, f"epoch {s.page.epoch}") for s in heard.states]
            case _:
                told = [(t, "LEASE") for t in heard.leases]
        last = next(((t, what) for t, what in reversed(told) if t <= until_ns), None)
        return None if last is None else f"{last[1]}, at {self._s(last[0])}"

    def _silence(self, one: Expectation, last_ns: int | None) -> str:
        if last_ns is None:
            return "nothing to the contrary was heard"
        what = "it was heard"
        if one.subject == "epoch":
            what = "another epoch was named"
        elif one.subject == "nothing":
            what = f"{', '.join(element for t, element in self._heard.reports if t == last_ns)} was reported"
        return f"{what}, last at {self._s(last_ns)}, {self._after(one, last_ns)}"

    def _after(self, one: Expectation, t_ns: int) -> str:
        return f"{(t_ns - self._ns(one.from_ns)) / 1e6:.1f} ms after {self._s(self._ns(one.from_ns))}"

    def _s(self, t_ns: int) -> str:
        return f"{(t_ns - self._start_ns) / 1e9:.3f} s"


def _patience_ns(gap_ns: int) -> int:
    return gap_ns * 5 // 2


def holds_since(marks: Iterable[Mark], patience_ns: int, until_ns: int) -> int | None:
    """Return the time (ns) of the first frame of the chain that lasts until `until_ns`; None: there is no such chain.

    A chain is an unbroken series of frames that agree with an expectation.

    marks: the time of each frame, and whether the frame agrees with the expectation.
    patience_ns: longest gap between two frames of a chain, and after its last frame.
    """
    since_ns = last_ns = None
    for t_ns, says in marks:
        if t_ns > until_ns:
            break
        if not says:
            since_ns = None
        elif since_ns is None or last_ns is None or t_ns - last_ns > patience_ns:
            since_ns = t_ns
        last_ns = t_ns if says else last_ns
    if since_ns is None or last_ns is None or until_ns - last_ns > patience_ns:
        return None
    return since_ns
