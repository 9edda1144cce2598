"""A PE reports a silent input or output if, and only if, it is silent; verified against frames, epochs and steps.

*Sound.* Each report of a PE (EMCY STALE) names a module that the PE runs in its epoch, and a wired leaf of this module,
or an output of its mode. The PE runs the epoch for at least the limit: five periods, at least T_lease.

- For an input that is sent on a bus of the PE: within the limit (periods of the producer's slowest mode), the
  producer's node has sent no frame with it. The producer's PE was heard meanwhile, with the same epoch: a PE that is
  not heard at all is the manager's concern. If the producer's PE never sent such a datum, the limit is longer by
  START_UP_WINDOW_NS: the producer may still load its code.
- For an output: for as long as the limit, each step of the module has left the output out, although it had a datum of
  each variable that its mode names.
- For an input that no bus carries, the same as for the output of its producer. This is not verified if other faults
  than silences were injected: a module that hangs does not give anything either.

The end of a silence is reported only after its begin.

*Complete* (`untold`). In a flight in which modules fell silent and nothing else happened, each of these silences was
reported in time: by the PE of the module for each output, and by the PE of each reader for each wired leaf. In time is
the limit after the last datum, and two heartbeats of the reporting PE. A PE sends one report in a heartbeat period, so
each other silence that the same PE reports adds one heartbeat. An input that fell silent before the reader's PE had
been active in its epoch for the limit counts as one that never came.

Not verified: what a PE reports while it runs an epoch whose configuration cannot be put together from the frames.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from heronry_dg.configuration import Configuration, Wire
from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_manager.core.topology import uplink_bus
from heronry_tools.recording.commanded import Commanded
from heronry_tools.sim.oracles.epochs import EpochCheck
from heronry_tools.sim.oracles.limits import LEASE_PERIODS, SILENCE_REPORT_NS, SILENT_PERIODS, START_UP_WINDOW_NS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.steps_seen import Withheld
from heronry_wire.canaerospace import node_of
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import state_id
from heronry_wire.management import Emergency, FaultCode
from heronry_wire.silence import Silence
from heronry_wire.state_frames import PeState

_KEPT = 32  # times of frames that are kept for each source and bus
_SLACK_NS = 3_000_000  # clocks differ
_SENDING_NS = 15_000_000  # longest time from the decision of a PE until its report is on the bus
_HEARTBEATS = 2
_TICKS = 5  # leases between two looks at what had to be reported

_Key = tuple[str, str, Silence]  # PE, module, and which input or output


class _Run(NamedTuple):
    """Steps in a row, from the first to the last, that left an output out.

    supplied_ns: the first and the last of its last steps in a row for which all inputs were there.
    """

    first_ns: int
    last_ns: int
    supplied_ns: tuple[int, int] | None = None


class _Epoch(NamedTuple):
    """The epoch that a PE reports, since when, and since when it is active in it (None: it is not)."""

    number: int
    since_ns: int
    active_ns: int | None


class StaleCheck(Oracle):
    """Compares the reports of silences with the frames on the buses and with the steps of modules."""

    def __init__(self, spec: Spec, commanded: Commanded, epochs: EpochCheck) -> None:
        super().__init__()
        self._spec, self._commanded, self._states = spec, commanded, epochs
        self._modules, self._variables = list(spec.modules), list(spec.variables)
        self._identifiers = identifiers(spec)
        self._wanted = frozenset(self._identifiers.values())
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}
        self._uplink = {pe: spec.buses[uplink_bus(spec, pe)] for pe in spec.pes}
        self._sent_ns: dict[tuple[str, int, int], deque[int]] = {}  # by bus, identifier and node
        self._epochs: dict[str, _Epoch] = {}  # by PE
        self._before: dict[str, _Epoch] = {}  # the epoch before that, by PE
        self._left_out: dict[tuple[str, str, str], _Run] = {}  # by PE, module and variable
        self._silenced: dict[str, tuple[int, int]] = {}  # by NAME or NAME@PE: since when, and which output
        self._told_ns: dict[_Key, int] = {}  # silences that are not over: the last report
        self._local: list[Violation] = []  # not violated if other faults than silences were injected
        self._untold: dict[_Key, Violation] = {}
        self._leases = 0

    def take_over(self, before: "StaleCheck") -> None:
        """Take over what the oracle of another spec knows of the epochs of the PEs."""
        self._epochs, self._before = before._epochs, before._before

    # What is seen

    def published(self, sent: Sent) -> None:
        """Keep the time of a data frame."""
        can_id, node = sent.frame.can_id, node_of(sent.frame.data)
        if can_id not in self._wanted or node is None:
            return
        times = self._sent_ns.get((sent.bus, can_id, node))
        if times is None:
            times = self._sent_ns[sent.bus, can_id, node] = deque(maxlen=_KEPT)
        times.append(sent.end_ns)

    def said(self, state: StateSaid) -> None:
        """Record the epoch of a PE, and since when it is active in it."""
        before, page = self._epochs.get(state.pe), state.page
        goes_on = before is not None and before.number == page.epoch
        since_ns = before.since_ns if before is not None and goes_on else state.t_ns
        active_ns = before.active_ns if before is not None and goes_on else None
        if before is not None and not goes_on:
            self._before[state.pe] = before
        is_active = page.state is PeState.ACTIVE
        self._epochs[state.pe] = _Epoch(page.epoch, since_ns, (active_ns or state.t_ns) if is_active else None)

    def withheld(self, step: Withheld) -> None:
        """Record which outputs a step has left out."""
        running = self._configuration(step.pe)
        if running is None or step.module not in running.modules:
            return
        mode = running.mode(self._spec, step.module)
        has_all = step.inputs.issuperset({leaf.variable for _, leaf in mode.leaves()})
        for variable in step.missing:
            key = step.pe, step.module, variable
            run, supplied_ns = self._left_out.get(key), None
            first_ns = before_ns = step.t_ns
            if run is not None and step.t_ns - run.last_ns <= self._missed_ns(mode.rate_mhz):
                first_ns, before_ns, supplied_ns = run
            if has_all:
                goes_on = supplied_ns is not None and supplied_ns[1] == before_ns
                supplied_ns = (supplied_ns[0] if supplied_ns is not None and goes_on else step.t_ns, step.t_ns)
            self._left_out[key] = _Run(first_ns, step.t_ns, supplied_ns)

    def silenced(self, t_ns: int, module: str, output: int) -> None:
        """Record that a module falls silent."""
        self._silenced[module] = t_ns, output

    def unsilenced(self, module: str) -> None:
        """Record that a module is no longer silent."""
        self._silenced.pop(module, None)

    def leased(self, t_ns: int) -> None:
        """Look, from time to time, for silences that had to be reported by now."""
        self._leases += 1
        if self._silenced and self._leases % _TICKS == 0:
            for key, due_ns in self._promised():
                told_ns = self._told_ns.get(key)
                if t_ns > due_ns and (told_ns is None or told_ns < due_ns - 2 * SILENCE_REPORT_NS):
                    pe, module, silence = key
                    what = "output" if silence.is_output else "input"
                    story = f"{pe} has not reported in time that {what} {silence.number} of {module} is silent"
                    self._untold.setdefault(key, Violation(t_ns, "stale", story))

    def untold(self) -> list[Violation]:
        """Return the silences that were not reported in time, if nothing but silences was injected."""
        return [*self._untold.values(), *self._local]

    # Sound

    def emergency(self, sent: Sent, pe: str, message: Emergency | Malformed) -> None:
        """Verify the report of a silence, or of its end."""
        if isinstance(message, Malformed) or message.code is not FaultCode.STALE:
            return
        silence, module = Silence.of(message.detail), self._modules[message.index]
        key = pe, module, Silence(silence.number, silence.is_output)
        if silence.is_over:
            self._told_ns.pop(key, None)
            return
        is_first = key not in self._told_ns
        self._told_ns[key] = sent.end_ns
        running, epoch = self._configuration(pe), self._epochs[pe]
        if running is None:
            return
        here = running.modules.get(module)
        if here is None or here.pe != pe:
            self._wrong(sent, f"{pe} reports a silence of {module}, which it does not run in epoch {epoch.number}")
            return
        mode = running.mode(self._spec, module)
        if silence.is_output:
            variable = self._variables[silence.number] if silence.number < len(self._variables) else "no variable"
            self._assess_output(sent, pe, module, variable, gives=variable in mode.gives, is_first=is_first)
            return
        leaves = list(mode.leaves())
        path = leaves[silence.number][0] if silence.number < len(leaves) else ""
        wire = here.inputs.get(path) if silence.number < len(leaves) else None
        if wire is None:
            self._wrong(sent, f"{pe} reports that input {silence.number} of {module} is silent, which is not wired")
        else:
            origin = running.modules[wire.producer].pe
            self._assess_input(sent, pe, module, wire, origin)
            if is_first:
                self._assess_moment(sent, pe, (module, path), wire, origin)

    def _assess_output(self, sent: Sent, pe: str, module: str, variable: str, *, gives: bool, is_first: bool) -> None:
        story = f"{pe} reports that {module} does not give {variable}"
        if not gives:
            self._wrong(sent, f"{story}, which is no output of its mode")
        elif not self._is_left_out(sent.end_ns, pe, module, variable, supplied=is_first):
            self._wrong(sent, f"{story}, but it does, or lacks an input")

    def _is_left_out(self, t_ns: int, pe: str, module: str, variable: str, *, supplied: bool) -> bool:
        """Tell whether the last steps of a module, over the limit, have left an output out.

        supplied: only steps with all inputs count.
        """
        run, running = self._left_out.get((pe, module, variable)), self._configuration(pe)
        if run is None or running is None:
            return False
        rate_mhz = running.mode(self._spec, module).rate_mhz
        period_ns = 10**12 // rate_mhz
        first_ns, last_ns = (run.supplied_ns or (t_ns, t_ns)) if supplied else (run.first_ns, run.last_ns)
        was_long = last_ns - first_ns + 2 * period_ns >= self._limit_ns(pe, period_ns) - _SLACK_NS
        waited_ns = self._waited_ns(pe, first_ns) if supplied else 0
        return was_long and t_ns - last_ns <= self._missed_ns(rate_mhz) + _SENDING_NS + waited_ns

    def _assess_input(self, sent: Sent, pe: str, module: str, wire: Wire, origin: str) -> None:
        t_ns, source = sent.end_ns, (wire.producer, wire.variable)
        since_ns = t_ns - self._limit_ns(pe, self._slowest_ns(*source)) + _SLACK_NS
        story = f"{pe} reports that {module} gets no {wire.variable} from {wire.producer}"
        times = self._times(pe, wire, origin)
        heard = [at_ns for at_ns in times if since_ns < at_ns < t_ns - _SENDING_NS]
        if heard:
            self._wrong(sent, f"{story}, which was sent at {heard[-1] / 1e9:.3f} s")
        if origin == pe and not times and not self._is_left_out(t_ns, pe, *source, supplied=False):
            self._local.append(Violation(t_ns, "stale", f"{story}, which gives it"))

    def _times(self, pe: str, wire: Wire, origin: str) -> list[int]:
        """Return the times of the last data that a PE sent through a wire, on the buses of the reader's PE."""
        can_id, node = self._identifiers[wire.producer, wire.variable], self._node_of[origin]
        return [at_ns for bus in self._spec.pes[pe].buses for at_ns in self._sent_ns.get((bus, can_id, node), ())]

    def _assess_moment(self, sent: Sent, pe: str, leaf: tuple[str, str], wire: Wire, origin: str) -> None:
        """Verify that a PE that reports an input for the first time has waited long enough, and for a PE that lives.

        A silence goes on in a new epoch that wires the leaf (module and path) as the epoch before did.
        """
        epoch = self._epochs[pe]
        late_ns = sent.end_ns - self._limit_ns(pe, self._slowest_ns(wire.producer, wire.variable)) + _SLACK_NS
        never_came = origin != pe and not self._times(pe, wire, origin)
        since_ns = late_ns - START_UP_WINDOW_NS if never_came else late_ns
        story = f"{pe} reports that {wire.producer} is silent"
        if epoch.since_ns > since_ns and not self._was_wired(pe, leaf, wire, origin, since_ns):
            self._wrong(sent, f"{story}, but it runs this epoch only since {epoch.since_ns / 1e9:.3f} s")
        last = self._states.last.get((self._uplink[pe].name, state_id(self._node_of[origin])))
        if origin != pe and last is not None and (last.page.epoch != epoch.number or last.t_ns < late_ns):
            self._wrong(sent, f"{story}, but {origin} itself is silent, or runs another epoch")

    def _was_wired(self, pe: str, leaf: tuple[str, str], wire: Wire, origin: str, since_ns: int) -> bool:
        """Tell whether the epoch before wired a leaf in the same way, and began before `since_ns`."""
        before = self._before.get(pe)
        known = None if before is None else self._commanded.epochs.get(before.number)
        running = None if known is None else known.configuration
        if before is None or running is None or before.since_ns > since_ns or wire.producer not in running.modules:
            return False
        module, path = leaf
        here = running.modules.get(module)
        is_same = here is not None and here.pe == pe and here.inputs.get(path) == wire
        return is_same and running.modules[wire.producer].pe == origin

    def _wrong(self, sent: Sent, story: str) -> None:
        self.violations.append(Violation(sent.end_ns, "stale", story))

    # Complete

    def _promised(self) -> Iterator[tuple[_Key, int]]:
        """Yield the silences that had to be reported, or will have to, each with the latest time for the report."""
        for target, (from_ns, number) in self._silenced.items():
            module, _, place = target.partition("@")
            current = self._commanded.current
            running = None if current is None else current.configuration
            here = None if running is None else running.modules.get(module)
            if running is None or here is None or place not in ("", here.pe):
                continue
            active_ns = self._active_ns(here.pe)
            if active_ns is None:
                continue
            gives = list(running.mode(self._spec, module).gives)
            for variable in gives[number - 1 : number] if number else gives:
                yield from self._of_output(here.pe, module, variable)
                yield from self._of_readers(running, module, variable, from_ns, active_ns)

    def _of_output(self, pe: str, module: str, variable: str) -> Iterator[tuple[_Key, int]]:
        run, running = self._left_out.get((pe, module, variable)), self._configuration(pe)
        active_ns = self._active_ns(pe)
        supplied_ns = None if run is None else run.supplied_ns
        if (
            run is not None
            and supplied_ns is not None
            and supplied_ns[1] == run.last_ns
            and running is not None
            and active_ns is not None
        ):
            period_ns = 10**12 // running.mode(self._spec, module).rate_mhz
            begin_ns = max(supplied_ns[0], active_ns)
            key = pe, module, Silence(self._variables.index(variable), is_output=True)
            yield key, self._due_ns(pe, begin_ns, period_ns)

    def _of_readers(
        self, running: Configuration, module: str, variable: str, silent_ns: int, given_ns: int
    ) -> Iterator[tuple[_Key, int]]:
        """Yield the silent inputs of what a module gives since `given_ns`, and does not give since `silent_ns`."""
        period_ns = self._slowest_ns(module, variable)
        for reader, path, wire in running.wires():
            pe = running.modules[reader].pe
            active_ns = self._active_ns(pe)
            if (wire.producer, wire.variable) != (module, variable) or active_ns is None:
                continue
            leaf = [one for one, _ in running.mode(self._spec, reader).leaves()].index(path)
            wired_ns = max(given_ns, active_ns)
            loading_ns = START_UP_WINDOW_NS if silent_ns < wired_ns + self._limit_ns(pe, period_ns) else 0
            yield (pe, reader, Silence(leaf)), self._due_ns(pe, max(silent_ns, wired_ns) + loading_ns, period_ns)

    def _due_ns(self, pe: str, begin_ns: int, period_ns: int) -> int:
        return begin_ns + self._limit_ns(pe, period_ns) + self._waited_ns(pe, begin_ns) + _SENDING_NS

    def _waited_ns(self, pe: str, since_ns: int) -> int:
        """Return the longest time for which a report waits in a PE, beside the others since `since_ns`."""
        others = sum(1 for key, at_ns in self._told_ns.items() if key[0] == pe and at_ns >= since_ns)
        return (_HEARTBEATS + others) * self._uplink[pe].heartbeat_ns

    def _missed_ns(self, rate_mhz: int) -> int:
        """Return the time after a step at which the next one is certainly missing."""
        return 10**12 // rate_mhz * 3 // 2 + _SLACK_NS

    # What the spec and the epochs say

    def _configuration(self, pe: str) -> Configuration | None:
        """Return the configuration that a PE runs, as it reports; None: it is not known."""
        epoch = self._epochs.get(pe)
        known = None if epoch is None else self._commanded.epochs.get(epoch.number)
        return None if known is None else known.configuration

    def _active_ns(self, pe: str) -> int | None:
        """Return the time since which a PE is active in the epoch that was activated last; None: it is not."""
        epoch, current = self._epochs.get(pe), self._commanded.current
        return epoch.active_ns if epoch is not None and current is not None and epoch.number == current.number else None

    def _limit_ns(self, pe: str, period_ns: int) -> int:
        return max(SILENT_PERIODS * period_ns, LEASE_PERIODS * self._uplink[pe].heartbeat_ns)

    def _slowest_ns(self, module: str, variable: str) -> int:
        modes = self._spec.modules[module].modes.values()
        return 10**12 // min(mode.rate_mhz for mode in modes if variable in mode.gives)
