"""Which mission phase this PE asks for: a module does by itself, or what it gives satisfies a phase's rule.

A rule watches a variable where it is made: on the PE that runs a module which gives it, at every value that this module
gives. So it needs no frame on any bus, and costs nothing where nobody else reads the variable. It does not work while
no module that gives the variable runs.

    armed     the value is not beyond the threshold, or has not been for `hold_ns` without a break yet
    fired     it was: the phase has been asked for, once. Armed again when the value has been back for `hold_ns`

A break is a value on the other side, or none for three periods. Of several rules that fire at one value, the last phase
in the spec's order is asked for. A rule only ever leads on, to a later phase of the spec; a module may ask for any.

A module that asks for the same phase in every step asks once. What it asked for last stands until it asks for another,
or stops; the last standing request of this PE is made again when a new term begins, under its number and leading on
alone, because that manager may know nothing of it. One that does know has obeyed it.

What if: a request is lost, late, doubled or forged is `faults`' and the manager's matter. A pause is a break of the
value like any other. A module that starts here, because another PE has failed, begins with every rule armed: one that
holds fires again, and as it only leads on, that changes nothing but what an operator has turned back. A restart is the
same.
"""

from dataclasses import dataclass

from heronry_agent.core.faults import Faults
from heronry_agent.core.schedule import NS_MHZ
from heronry_agent.core.table_index import TableIndex
from heronry_agent.module import Value
from heronry_wire.frame import Frame
from heronry_wire.pe_table import PhaseEntry

_LONGEST_BREAK_PERIODS = 3


@dataclass(slots=True)
class _Watch:
    """One rule, at one module."""

    phase: int
    rule: PhaseEntry
    longest_break_ns: int
    armed: bool = True
    since_ns: int | None = None  # since when the value has been where it must be for the next change
    seen_ns: int = 0

    def see(self, value: float, now_ns: int) -> bool:
        """Take a value; tells whether the rule fires."""
        if now_ns - self.seen_ns > self.longest_break_ns:
            self.since_ns = None
        self.seen_ns = now_ns
        if self._is_beyond(value) is not self.armed:
            self.since_ns = None
            return False
        if self.since_ns is None:
            self.since_ns = now_ns
        if now_ns - self.since_ns < self.rule.hold_ns:
            return False
        self.armed, self.since_ns = not self.armed, None
        return not self.armed

    def _is_beyond(self, value: float) -> bool:
        above, below = self.rule.above, self.rule.below
        return (above is not None and value > above) or (below is not None and value < below)


class PhaseRequests:
    """What the modules of one PE ask for."""

    def __init__(self, index: TableIndex, faults: Faults) -> None:
        self._index, self._faults = index, faults
        self._watches: dict[int, dict[str, list[_Watch]]] = {}  # by module and variable
        self._asked: dict[int, int] = {}  # phase that each module asked for last
        self._standing: int | None = None  # module that made the last request of this PE

    def started(self, module: int, mode: int) -> None:
        """A module starts: watch what it gives."""
        entry = self._index.modules[module].modes[mode]
        longest_break_ns = _LONGEST_BREAK_PERIODS * NS_MHZ // entry.rate_mhz
        watches: dict[str, list[_Watch]] = {}
        for phase, rule in enumerate(self._index.table.phases):
            if rule.variable is not None and rule.variable in entry.gives:
                watches.setdefault(rule.variable, []).append(_Watch(phase, rule, longest_break_ns))
        self._watches[module] = watches

    def stopped(self, module: int) -> None:
        """A module stops: what it asked for is asked for no more."""
        self._watches.pop(module, None)
        self._asked.pop(module, None)
        if self._standing == module:
            self._standing = None
            self._faults.withdraw_request()

    def gave(self, module: int, variable: str, value: Value, now_ns: int) -> list[Frame]:
        """A module has given a value: what to send now."""
        watches = self._watches[module].get(variable)
        if not watches or not isinstance(value, int | float):
            return []
        fired = [watch.phase for watch in watches if watch.see(value, now_ns)]
        return self._request(module, fired[-1], now_ns, forward_only=True) if fired else []

    def asked(self, module: int, phase: int, now_ns: int) -> list[Frame]:
        """A module asks for a phase: what to send now."""
        if self._asked.get(module) == phase:
            return []
        self._asked[module] = phase
        return self._request(module, phase, now_ns, forward_only=False)

    def new_mastership(self, now_ns: int) -> list[Frame]:
        """A new term has begun: what to send now. What nobody has acknowledged is asked for as it was."""
        return [] if self._faults.is_asking else self._faults.repeat_request(now_ns)

    def _request(self, module: int, phase: int, now_ns: int, *, forward_only: bool) -> list[Frame]:
        self._standing = module
        return self._faults.request_phase(phase, now_ns, forward_only=forward_only)
