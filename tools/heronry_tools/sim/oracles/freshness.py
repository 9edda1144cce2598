"""No module is given a datum that is old, or that its producer has not sent; verified against frames on the bus.

Two things must hold for every input that the PE's epoch wires to another PE:

- The producer's node has sent a frame on one of the PE's buses within three periods of the producer's slowest
  mode.
- The value given to the module is that of one of these frames. An input with another value is called *foreign*.

The three periods end at the moment at which the PE requested the step. After this moment a slow processor may
still delay the step; `until_ns` limits this delay (at most T_lease).

Every step of a module that drives an actuator, or is a branch of a DEMUX, is verified. Of all other steps with
inputs, every eighth is verified (`world.steps_seen`).

Not verified:

- an input from the same PE, and a variable with an initial value;
- the time from the activation of an epoch until the PE's state frames show that the PE runs this epoch.
"""

from collections import deque

from heronry_agent.module import Datum, Value
from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_tools.recording.commanded import Commanded
from heronry_tools.sim.oracles.limits import FRESH_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.steps_seen import Driven
from heronry_wire.canaerospace import decode_data, node_of
from heronry_wire.frame import Frame, Malformed

_MORE = 8  # frames kept beyond those of three periods: frames bunch up after a delay
_SLACK_NS = 2_000_000  # added to the age limit: the PE's clock may run slow
_UNTOLD_NS = 50_000_000  # after a PE first reports an epoch; its inputs are not verified before


class FreshnessCheck(Oracle):
    """Compares the inputs given to modules with the data frames on the buses."""

    def __init__(self, spec: Spec, commanded: Commanded) -> None:
        super().__init__()
        self._spec, self._commanded = spec, commanded
        self._identifiers = identifiers(spec)
        self._remembered = {number: _fresh_frames(spec, *source) for source, number in self._identifiers.items()}
        self._oldest_ns = {source: _fresh_ns(spec, *source) for source in self._identifiers}
        self._last: dict[tuple[str, int, int], deque[tuple[int, Frame]]] = {}  # by bus, identifier and node
        self._epochs: dict[int, tuple[int, int]] = {}  # by node: the epoch that it reports, and since when (ns)
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}

    def take_over(self, before: "FreshnessCheck") -> None:
        """Take over the data frames that the oracle of another spec has kept, by the names of their sources."""
        sources = {number: source for source, number in before._identifiers.items()}
        self._epochs = before._epochs
        for (bus, number, node), frames in before._last.items():
            identifier = self._identifiers.get(sources[number])
            if identifier is not None:
                self._last[bus, identifier, node] = deque(frames, maxlen=self._remembered[identifier])

    def published(self, sent: Sent) -> None:
        """Keep a data frame, with which the inputs of modules are compared later."""
        frame = sent.frame
        most = self._remembered.get(frame.can_id)
        node = node_of(frame.data)
        if most is None or node is None:
            return
        key = (sent.bus, frame.can_id, node)
        last = self._last.get(key)
        if last is None:
            last = self._last[key] = deque(maxlen=most)
        last.append((sent.end_ns, frame))

    def told(self, state: StateSaid) -> None:
        """Record the epoch that a PE reports."""
        node, epoch = state.node, state.page.epoch
        if self._epochs.get(node, (None,))[0] != epoch:
            self._epochs[node] = (epoch, state.t_ns)

    def looked(self, stepped: Driven) -> None:
        """Verify, as `driven` does, the inputs of one step of any other module."""
        self.driven(stepped)

    def driven(self, driven: Driven) -> None:
        """Verify that the inputs of one step of a module were fresh, and were sent by their producers.

        The module drives an actuator, or is a branch of a DEMUX.
        """
        told, since_ns = self._epochs.get(self._node_of[driven.pe], (0, driven.t_ns))
        epoch = self._commanded.epochs.get(told)
        if epoch is None or epoch is not self._commanded.current or driven.t_ns - since_ns < _UNTOLD_NS:
            return
        if epoch.configuration is None:
            return
        running = epoch.configuration.modules.get(driven.module)
        if running is None or running.pe != driven.pe:
            return
        for path, (variable, datum) in driven.inputs.items():
            wire = running.inputs.get(path)
            if wire is None or self._spec.variables[variable].initial is not None:
                continue
            origin = epoch.configuration.modules[wire.producer].pe
            if origin != driven.pe:
                self._assess(driven, (wire.producer, variable), datum, self._node_of[origin])

    def _assess(self, driven: Driven, source: tuple[str, str], datum: Datum, node: int) -> None:
        identifier, since_ns = self._identifiers[source], driven.asked_ns - self._oldest_ns[source]
        buses = self._spec.pes[driven.pe].buses
        heard = [last for bus in buses if (last := self._last.get((bus, identifier, node)))]
        if not any(last[-1][0] >= since_ns for last in heard):
            last_ns = max((last[-1][0] for last in heard), default=None)
            age = "never" if last_ns is None else f"{(driven.asked_ns - last_ns) / 1e6:.1f} ms ago"
            self._tell(driven, "freshness", source, f"last heard {age}")
        elif not any(_said(last, since_ns, datum.value) for last in heard):
            self._tell(driven, "foreign", source, f"but node {node} has sent no {datum.value!r} lately")

    def _tell(self, driven: Driven, rule: str, source: tuple[str, str], what: str) -> None:
        producer, variable = source
        story = f"{driven.module} on {driven.pe} is given {variable} of {producer}, {what}"
        self.violations.append(Violation(driven.t_ns, rule, story))


def _rates_mhz(spec: Spec, producer: str, variable: str) -> list[int]:
    return [mode.rate_mhz for mode in spec.modules[producer].modes.values() if variable in mode.gives]


def _fresh_ns(spec: Spec, producer: str, variable: str) -> int:
    """Return the age (ns) up to which a datum of a source is fresh: periods of its slowest mode, with some slack."""
    return FRESH_PERIODS * 10**12 // min(_rates_mhz(spec, producer, variable)) + _SLACK_NS


def _fresh_frames(spec: Spec, producer: str, variable: str) -> int:
    """Return the largest number of frames of a source that can be fresh at one time."""
    rates = _rates_mhz(spec, producer, variable)
    return FRESH_PERIODS * max(rates) // min(rates) + _MORE


def _said(last: deque[tuple[int, Frame]], since_ns: int, value: Value) -> bool:
    """Tell whether a frame since `since_ns` carries this value; the search begins with the newest frame."""
    return any(t_ns >= since_ns and _says(frame, value) for t_ns, frame in reversed(last))


def _says(frame: Frame, value: Value) -> bool:
    decoded = decode_data(frame)
    if isinstance(decoded, Malformed):
        return False
    said = 0 if decoded.value is None else decoded.value
    return said == value or repr(said) == repr(value)  # NaN is not equal to itself, so it is compared as text
