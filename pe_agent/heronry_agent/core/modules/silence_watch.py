"""Finds the silent inputs and outputs of the modules of one PE (protocol rule 8).

An *input* is a wired leaf of a running module. For each input a clock runs from the last datum of its source:

    never seen   no datum has come since the source got its present producer. The producer may still load its code, so
                 the limit is longer by START_UP_WINDOW_NS. (If it runs and gives nothing, its PE reports the output)
    fresh        a datum has come within the limit: five periods of the source, at least T_lease
    silent       the clock has passed the limit; this is reported, and again its end, when a datum comes

An *output* is a variable that the mode of a running module gives. For each output that a step leaves out although every
variable that the mode names is fresh, a clock runs from the step before. Its limit is five periods of the module, at
least T_lease. A step that gives the variable ends the silence. An output that a step leaves out while an input is
missing is not silent: what counts then is the input.

*The clocks start again*

- with each activation step of a configuration, since then the producer may have just moved;
- while no manager is heard, to whom a silence could be told;
- after a pause of this process, in which data may have been lost.

The clock of an output starts again when its module is started, or when a step of its module is held back.

*What is not reported.* If the producer has failed on this PE, or if its PE is silent itself or runs another epoch, the
manager knows this already. So an input from another PE is reported only if a state frame of that PE with the epoch of
this PE came in the second half of the time. A PE receives few states that say nothing new (`thinning`), so a datum that
came from that PE since such a state counts as well. A PE that never hears state frames of the producer, because they do
not reach its bus, must have heard any other node instead. So a PE that hears nothing blames nobody.

*A new configuration.* A silence goes on if the module still runs in the same mode, and the leaf is still wired to the
same source on the same PE, and the silence was reported. Any other silence is dropped without a report; the manager
knows what the new configuration has.

The watch looks at the clocks with the heartbeat of this PE, and only when one of them may have passed its limit. So a
silence is found at most one heartbeat period late.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from heronry_agent.core.authority import OutputAuthorization
from heronry_agent.core.modules.mailboxes import Mailbox, Mailboxes
from heronry_agent.core.reports import SilenceReports
from heronry_agent.core.step_times import NS_MHZ
from heronry_agent.core.table_index import TableIndex
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import state_id
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.protocol_times import START_UP_WINDOW_NS, silent_after_ns
from heronry_wire.sansio import NEVER_NS
from heronry_wire.silence import Silence

_PAUSED_PERIODS = 2  # after so many heartbeat periods without a look, this process was paused


@dataclass(frozen=True, slots=True)
class _Input:
    """A wired leaf of a module.

    silence: names the leaf in reports.
    producer: index of the module that gives it, if that module is on this PE; else None.
    state_id: identifier of the state frames of the producer's PE.
    wiring: mode of the module, source and node of the producer; while they stay the same, a silence goes on.
    """

    module: int
    silence: Silence
    box: Mailbox
    limit_ns: int
    producer: int | None
    state_id: int
    wiring: tuple[int, int, int]


class SilenceWatch:
    """Keeps the clocks of all inputs and outputs of one PE, and reports the silent ones."""

    def __init__(
        self,
        index: TableIndex,
        mailboxes: Mailboxes,
        output_authorization: OutputAuthorization,
        reports: SilenceReports,
        period_ns: int,
    ) -> None:
        """Begin without inputs and outputs; `period_ns` is the heartbeat period of the uplink."""
        self._index, self._mailboxes, self._output_authorization = index, mailboxes, output_authorization
        self._reports = reports
        self._paused_ns = _PAUSED_PERIODS * period_ns
        self._variables = {variable: number for number, variable in enumerate(index.table.variables)}
        self._index_of = {entry.name: module for module, entry in index.modules.items()}
        self._inputs: tuple[_Input, ...] = ()
        self._since_ns = 0  # no clock starts before
        self._looked_ns = 0
        self._next_ns = NEVER_NS
        self.heard_ns: dict[
            int, int
        ] = {}  # by identifier of its states: when another PE last named the epoch of this PE
        self.withholding: dict[int, dict[str, int]] = {}  # by module: outputs left out, each since when
        self._begun_ns: dict[int, int] = {}  # by module

    def carry_over(self) -> None:
        """Begin anew with another table, whose contents `index` has now: silences are found again."""
        self._variables = {variable: number for number, variable in enumerate(self._index.table.variables)}
        self._index_of = {entry.name: module for module, entry in self._index.modules.items()}
        self._inputs = ()
        for key in self._reports.silent():
            self._reports.drop(*key)
        self.withholding.clear()
        self._begun_ns.clear()

    def rewire(self, wanted: Slice, now_ns: int) -> None:
        """Watch the inputs of a new slice; the mailboxes have been rewired before."""
        before = self._wirings()
        self._inputs = tuple(
            self._input(module.module, module.mode, leaf, source, wanted.remote.get(source))
            for module in wanted.modules
            for leaf, source in enumerate(module.sources)
            if source is not None
        )
        now = self._wirings()
        for key in self._reports.silent():
            if (key in before and now.get(key) != before[key]) or not self._reports.is_told(*key):
                self._reports.drop(*key)
        self.heard_ns = dict.fromkeys(self.heard_ns, 0)
        self.restart(now_ns)

    def _wirings(self) -> dict[tuple[int, Silence], tuple[int, int, int]]:
        return {(one.module, one.silence): one.wiring for one in self._inputs}

    def _input(self, module: int, mode: int, leaf: int, source: int, node: int | None) -> _Input:
        entry, origin = self._index.table.sources[source], self._index.node if node is None else node
        return _Input(
            module,
            Silence(leaf),
            self._mailboxes.boxes[source],
            silent_after_ns(entry.period_ns, self._index.lease_ns),
            self._index_of[entry.module] if node is None else None,
            state_id(origin),
            (mode, source, origin),
        )

    def restart(self, now_ns: int) -> None:
        """Let all clocks start again now."""
        self._since_ns = self._next_ns = now_ns

    def began(self, module: int, now_ns: int) -> None:
        """Note that a module is started or stopped: its outputs have new clocks."""
        self._begun_ns[module] = now_ns
        self.withholding.pop(module, None)
        for silent, silence in self._reports.silent():
            if silent == module and silence.is_output:
                self._reports.drop(module, silence)

    def held(self, module: int, now_ns: int) -> None:
        """Note that a step of a module was held back, or lacked an input: the clocks of its outputs start again."""
        self._begun_ns[module] = now_ns
        withheld = self.withholding.pop(module, {})
        silent = {variable: since_ns for variable, since_ns in withheld.items() if self._is_silent(module, variable)}
        if silent:
            self.withholding[module] = silent

    def left_out(self, entry: ModuleEntry, mode: int, missing: Collection[str], now_ns: int) -> None:
        """Note which outputs a step of a module has left out.

        Called for each step that leaves an output out, and for the next ones, while `withholding` has the module.
        """
        module = entry.index
        withheld = self.withholding.pop(module, {})
        for variable in withheld.keys() - missing:
            self._reports.over(module, self._output(variable))
        if not missing:
            return
        self.withholding[module] = {variable: withheld[variable] for variable in missing if variable in withheld}
        leaves = {leaf.variable for leaf in entry.modes[mode].leaves}
        if not self._mailboxes.supply_all(module, leaves, now_ns):
            self.held(module, now_ns)
            return
        period_ns = NS_MHZ // entry.modes[mode].rate_mhz
        since_ns = max(now_ns - period_ns, self._begun_ns.get(module, now_ns))
        self.withholding[module] = {variable: withheld.get(variable, since_ns) for variable in missing}
        self._next_ns = min(self._next_ns, now_ns)

    def look(self, modes: Mapping[int, int], now_ns: int, *, is_steady: bool) -> Iterable[Frame]:
        """Find every input and output that has become silent, or has ceased to be; returns the report to send now.

        Called with the heartbeat of this PE.

        modes: mode of each module that runs. is_steady: a manager is heard, and the configuration is fully activated.
        """
        was_paused = now_ns - self._looked_ns > self._paused_ns
        self._looked_ns = now_ns
        if was_paused or not is_steady:
            self.restart(now_ns)
        elif now_ns >= self._next_ns:
            outputs_ns = self._look_at_outputs(modes, now_ns)  # reported first: readers of an output are silent, too
            self._next_ns = min(outputs_ns, self._look_at_inputs(modes, now_ns))
        return self._reports.tick(now_ns)

    def _look_at_inputs(self, modes: Mapping[int, int], now_ns: int) -> int:
        """Report the inputs; returns the time in ns at which the first of them may become silent."""
        next_ns = NEVER_NS
        for one in self._inputs:
            last_ns = one.box.time_ns
            silent_ns = self._reports.since_ns(one.module, one.silence)
            if silent_ns is not None:
                next_ns = now_ns
                if last_ns is not None and last_ns > silent_ns:
                    self._reports.over(one.module, one.silence)
                continue
            since_ns = self._since_ns if last_ns is None else max(last_ns, self._since_ns)
            limit_ns = one.limit_ns if last_ns is not None else one.limit_ns + START_UP_WINDOW_NS
            due_ns = since_ns + limit_ns
            if due_ns < now_ns and one.module in modes and self._is_the_producers(one, since_ns + limit_ns // 2, modes):
                self._reports.begun(one.module, one.silence, since_ns)
            next_ns = min(next_ns, due_ns, now_ns + one.limit_ns)  # a first datum may come in the next moment
        return next_ns

    def _is_the_producers(self, one: _Input, after_ns: int, modes: Mapping[int, int]) -> bool:
        """Tell whether the producer of an input runs, or its PE has been heard after `after_ns`, in the same epoch."""
        if one.producer is not None:
            return one.producer in modes
        heard_ns = self.heard_ns.get(one.state_id, self._output_authorization.heard_ns)
        return heard_ns > after_ns or (heard_ns > 0 and self._gives(one.state_id, after_ns))

    def _gives(self, state: int, after_ns: int) -> bool:
        """Tell whether an input has come after `after_ns` from the PE with this identifier of its states."""
        return any(one.state_id == state and (one.box.time_ns or 0) > after_ns for one in self._inputs)

    def _look_at_outputs(self, modes: Mapping[int, int], now_ns: int) -> int:
        """Report the outputs; returns the time in ns at which the first of them may become silent."""
        next_ns = NEVER_NS
        for module, withheld in self.withholding.items():
            mode = self._index.modules[module].modes[modes[module]]
            limit_ns = silent_after_ns(NS_MHZ // mode.rate_mhz, self._index.lease_ns)
            for variable, since_ns in withheld.items():
                if self._is_silent(module, variable):
                    continue
                due_ns = max(since_ns, self._since_ns) + limit_ns
                if due_ns < now_ns:
                    self._reports.begun(module, self._output(variable), since_ns)
                next_ns = min(next_ns, due_ns)
        return next_ns

    def _is_silent(self, module: int, variable: str) -> bool:
        return self._reports.since_ns(module, self._output(variable)) is not None

    def _output(self, variable: str) -> Silence:
        return Silence(self._variables[variable], is_output=True)
