"""Whether functions are really served, as seen on the bus: the witness for demo, simulator and tests.

The witness reads only frames, and nothing that the manager reports. A function counts as served while its
outputs are heard:

    an output with an actuator      the echo of the actuator, which shows to what it was commanded. An echo
                                    from a node that does not have the actuator is ignored
    an output without an actuator   the output frame of its module

A function is no longer served if none of these is heard for longer than three periods of the slowest mode of
all its output modules, plus a tenth of a second. If a bus has too little room for ten echoes a second, the period
of the echoes counts if it is longer. The witness also detects when two branches of one DEMUX are
driven in turn within this time (`rivals`).
"""

from dataclasses import dataclass, field

from heronry_dg.echo_rates import EchoRates
from heronry_dg.model import Function, Spec
from heronry_wire.canaerospace import DataType, decode_data
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import PE_NODES, actuator_echo_id

PATIENCE_PERIODS = 3
PATIENCE_NS = 100_000_000
_ECHO_NODES = {actuator_echo_id(node): node for node in PE_NODES}


@dataclass(frozen=True, slots=True)
class Output:
    """One frame of an output.

    t_ns: the end of the frame.
    module, node: the module of the output, and the node on which it drove its actuator or ran.
    value: the command to the actuator; None if the frame only shows that the module ran.
    """

    t_ns: int
    module: str
    node: int
    value: float | None


@dataclass(frozen=True, slots=True)
class Outage:
    """A time in which a function was not heard: from its last output to the next one.

    to_ns: None if there is no next output yet.
    """

    function: str
    from_ns: int
    to_ns: int | None


@dataclass(slots=True)
class _Watched:
    function: Function
    patience_ns: int
    last: Output | None = None
    before: Output | None = None  # the last one of another module than `last`
    outages: list[Outage] = field(default_factory=list)


class Witness:
    """Observes the outputs of one spec.

    rivals: pairs of outputs of two modules that serve one function in turn. A pair is found when a function is heard
        from a module B, then from A, and then from B again. The pair is the last output of A and the new output of B.
        It counts only if the last output of B before A is at most `patience_ns` older than the new output of B.
    """

    def __init__(self, spec: Spec) -> None:
        self.rivals: list[tuple[Output, Output]] = []
        self._modules = list(spec.modules.values())
        positions = {device: (spec.pes[d.pe].node_id, i) for i, (device, d) in enumerate(spec.devices.items())}
        self._drivers = {positions[m.device]: m.name for m in spec.modules.values() if m.device is not None}
        rates = EchoRates(spec)
        self._watched = {
            name: _Watched(function, PATIENCE_PERIODS * rates.longest_gap_ns(function.outputs) + PATIENCE_NS)
            for name, function in spec.functions.items()
        }
        self._functions_of: dict[str, list[_Watched]] = {}
        for watched in self._watched.values():
            for module in watched.function.outputs:
                self._functions_of.setdefault(module, []).append(watched)

    def see(self, t_ns: int, frame: Frame) -> Output | None:
        """Take a frame that ended at `t_ns`; returns the output that it shows, if any."""
        node = _ECHO_NODES.get(frame.can_id)
        if node is None or frame.extended:
            return None
        output = self._read(t_ns, node, frame)
        if output is not None:
            for watched in self._functions_of.get(output.module, ()):
                self._heard(watched, output)
        return output

    def served(self, function: str, now_ns: int) -> bool:
        """Tell whether an output of a function was heard at most `patience_ns` before `now_ns`."""
        watched = self._watched[function]
        return watched.last is not None and now_ns - watched.last.t_ns <= watched.patience_ns

    def last_output(self, function: str) -> Output | None:
        """Return the last output of a function that was heard; None where none was."""
        return self._watched[function].last

    def patience_ns(self, function: str) -> int:
        """Return the longest silence of a served function, in ns; after a longer silence it is not served."""
        return self._watched[function].patience_ns

    def outages(self, now_ns: int) -> list[Outage]:
        """List the outages of all functions in order of time: silences longer than `patience_ns` after an output."""
        found = [outage for watched in self._watched.values() for outage in watched.outages]
        for name, watched in self._watched.items():
            if watched.last is not None and not self.served(name, now_ns):
                found.append(Outage(name, watched.last.t_ns, None))
        return sorted(found, key=lambda outage: outage.from_ns)

    def go_on_from(self, before: "Witness") -> None:
        """Go on from what a witness of another spec has heard last of the functions with the same names."""
        for name, watched in self._watched.items():
            if name in before._watched:  # noqa: SLF001 - of this class
                watched.last = before.last_output(name)

    def forget(self) -> None:
        """Drop all recorded outages and all pairs in `rivals`, so that a witness can run for days without more memory.

        An outage is recorded when it is over; so an outage that still lasts is kept.
        """
        self.rivals.clear()
        for watched in self._watched.values():
            watched.outages.clear()

    def _read(self, t_ns: int, node: int, frame: Frame) -> Output | None:
        datum = decode_data(frame)
        if isinstance(datum, Malformed) or datum.node_id != node:
            return None
        if datum.data_type == DataType.FLOAT:
            module = self._drivers.get((node, datum.service_code))
            value = datum.value if isinstance(datum.value, float) else None
            return None if module is None else Output(t_ns, module, node, value)
        if datum.data_type == DataType.ULONG and isinstance(datum.value, int) and datum.value < len(self._modules):
            return Output(t_ns, self._modules[datum.value].name, node, None)
        return None

    def _heard(self, watched: _Watched, output: Output) -> None:
        last = watched.last
        if last is not None and output.t_ns - last.t_ns > watched.patience_ns:
            watched.outages.append(Outage(watched.function.name, last.t_ns, output.t_ns))
        if last is not None and last.module != output.module:
            before = watched.before
            if (
                before is not None
                and before.module == output.module
                and output.t_ns - before.t_ns <= watched.patience_ns
            ):
                self.rivals.append((last, output))
            watched.before = last
        watched.last = output
