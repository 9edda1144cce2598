"""Which mission phase a PE requests: one that a module requests, or one whose `when` rule in the spec is satisfied.

*Rules.* A `when` rule compares a variable with a threshold. A PE that runs the module which gives the variable checks
the rule, at each value that this module gives. So the values need not be sent on a bus, and the rule cannot fire while
no such module runs. A rule has two states:

    armed     the rule waits until the value has been beyond the threshold for `hold_ns` without a break. Then it fires:
              the phase is requested once
    fired     the rule waits until the value has been back (no longer beyond the threshold) for `hold_ns` without a
              break. Then it is armed again

A break is a value on the other side of the threshold, or three periods without a value.

*Origins.* A rule leads to its phase only from its *origins* (by default the phases before it in the spec). A module may
request any phase. If several rules fire at one value, only one phase is requested: rules whose origins contain the
present phase are preferred, and among these the phase that is last in the spec.

*The present phase.* The manager announces the present phase (CONTROL, HOLDS). If the new phase is an origin of a fired
rule whose values still come, the rule fires again. A PE that has missed the last announcement may request a phase to
which no rule leads from the present phase. The manager checks the origins itself: it acknowledges this request, and
keeps the phase.

*Requests.* A module that requests the same phase in every step makes one request. A request *stands* until its module
requests another phase or stops. When a new term begins, the PE sends its last standing request again, since the new
manager may not have received it. The repeated request keeps its number, so that no manager executes it twice. It
carries FORWARD_ONLY: the manager ignores the request unless a rule leads from the present phase to the requested one.
If the spec has a rule that leads back to an earlier phase, an acknowledged request of a rule is withdrawn when this
rule is armed again, because its condition no longer holds.

*Lost frames and restarts.* `faults` and the manager handle lost, late, doubled and forged requests. A pause of the
process is a break of the value. When a module starts on this PE, its rules are armed, even if they have fired on
another PE before. So a rule whose condition still holds fires again. The manager then changes the phase only if the
present one is an origin of the rule.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.reports import Faults
from heronry_agent.core.step_times import NS_MHZ
from heronry_agent.core.table_index import TableIndex
from heronry_agent.module import Value
from heronry_wire.frame import Frame
from heronry_wire.pe_table import PhaseEntry

_LONGEST_BREAK_PERIODS = 3


@dataclass(slots=True)
class _Watch:
    """One phase rule, applied to the values of its variable that one module gives."""

    phase: int
    rule: PhaseEntry
    longest_break_ns: int
    armed: bool = True
    since_ns: int | None = None  # since when the value has been beyond the threshold (armed), or back (fired)
    seen_ns: int = 0

    def see(self, value: float, now_ns: int) -> bool:
        """Apply the rule to a value; tells whether the rule fires now."""
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

    def holds(self, now_ns: int) -> bool:
        """Tell whether the rule has fired and is not armed again, and its variable still gets values."""
        return not self.armed and now_ns - self.seen_ns <= self.longest_break_ns

    def _is_beyond(self, value: float) -> bool:
        above, below = self.rule.above, self.rule.below
        return (above is not None and value > above) or (below is not None and value < below)


class PhaseRequests:
    """Makes the phase requests of one PE: those of its modules, and those of phase rules."""

    def __init__(self, index: TableIndex, faults: Faults) -> None:
        self._index, self._faults = index, faults
        self._watches: dict[int, dict[str, list[_Watch]]] = {}  # by module and variable
        self._requested: dict[int, int] = {}  # phase that each module requested last
        self._standing: int | None = None  # module whose request is the last one of this PE
        self._standing_watch: _Watch | None = None  # the rule that has made this request; None: the module itself
        self._returns = self._may_return()
        self._phase: int | None = None  # the phase that the manager told last

    def _may_return(self) -> bool:
        """Tell whether a rule may lead back to an earlier phase."""
        return any(origin > phase for phase, rule in enumerate(self._index.table.phases) for origin in rule.origins)

    def carry_over(self, carried: CarriedOver, modes: Mapping[int, int]) -> None:
        """Check the rules of another table; `modes`: mode of each module that goes on. All rules are armed again."""
        phases, modules = carried.phases, carried.modules
        requested = carried.by_module(self._requested)
        self._requested = {module: phases[phase] for module, phase in requested.items() if phase in phases}
        self._standing, self._standing_watch = modules.get(-1 if self._standing is None else self._standing), None
        self._phase, self._returns = phases.get(-1 if self._phase is None else self._phase), self._may_return()
        self._watches.clear()
        for module, mode in modes.items():
            self.started(module, mode)

    def started(self, module: int, mode: int) -> None:
        """Begin to check the phase rules of the variables that a module gives in this mode."""
        entry = self._index.modules[module].modes[mode]
        longest_break_ns = _LONGEST_BREAK_PERIODS * NS_MHZ // entry.rate_mhz
        watches: dict[str, list[_Watch]] = {}
        for phase, rule in enumerate(self._index.table.phases):
            if rule.variable is not None and rule.variable in entry.gives:
                watches.setdefault(rule.variable, []).append(_Watch(phase, rule, longest_break_ns))
        self._watches[module] = watches

    def stopped(self, module: int) -> None:
        """Stop checking the rules of a module that stops, and withdraw its request."""
        self._watches.pop(module, None)
        self._requested.pop(module, None)
        if self._standing == module:
            self._withdraw()

    def gave(self, module: int, variable: str, value: Value, now_ns: int) -> list[Frame]:
        """Apply a module's phase rules to a value that the module has given.

        Returns the frames of a phase request, if a rule fires.
        """
        watches = self._watches[module].get(variable)
        if not watches or not isinstance(value, int | float):
            return []
        fired = [watch for watch in watches if watch.see(value, now_ns)]
        standing = self._standing_watch
        if standing is not None and standing.armed and self._returns and not self._faults.is_asking:
            self._withdraw()
        return self._fire(module, [watch for watch in fired if self._phase in watch.rule.origins] or fired, now_ns)

    def entered(self, phase: int, now_ns: int) -> list[Frame]:
        """Note the phase that the manager announces; returns the frames of the requests that follow from it.

        If the phase is new, a rule that has fired before requests its phase once more, provided that its condition
        still holds and that the rule may be applied in the new phase.
        """
        if phase == self._phase:
            return []
        self._phase = phase
        frames = []
        for module, watches in self._watches.items():
            every = sorted((one for of in watches.values() for one in of), key=lambda watch: watch.phase)
            again = [watch for watch in every if watch.holds(now_ns) and phase in watch.rule.origins]
            frames += self._fire(module, again, now_ns)
        return frames

    def requested(self, module: int, phase: int, now_ns: int) -> list[Frame]:
        """Request a phase for a module; returns the frames to send, none if the module's last request was the same."""
        if self._requested.get(module) == phase:
            return []
        self._requested[module] = phase
        return self._request(module, phase, now_ns, watch=None)

    def new_mastership(self, now_ns: int) -> list[Frame]:
        """Return the frames that send an acknowledged phase request once more to the manager of a new term."""
        # `faults` repeats one that is not acknowledged
        return [] if self._faults.is_asking else self._faults.repeat_request(now_ns)

    def _fire(self, module: int, fired: list[_Watch], now_ns: int) -> list[Frame]:
        return self._request(module, fired[-1].phase, now_ns, watch=fired[-1]) if fired else []

    def _request(self, module: int, phase: int, now_ns: int, *, watch: _Watch | None) -> list[Frame]:
        self._standing, self._standing_watch = module, watch
        return self._faults.request_phase(phase, now_ns, forward_only=watch is not None)

    def _withdraw(self) -> None:
        self._standing = self._standing_watch = None
        self._faults.withdraw_request()
