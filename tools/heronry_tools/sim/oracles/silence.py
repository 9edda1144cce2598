"""A silent manager stops no function: if only managers have failed, every function is heard all the time.

With `without_manager: safe_mode` this is promised only for critical functions.

A function counts as silent from its last output on. A waiver counts if it holds at any moment between that output and
the moment at which the function had to be heard again.

A function may fall silent because the phase or a priority has changed, if other functions are now more important. This
is allowed if both hold:

- An epoch that was activated before the next output was due leaves the function out.
- While this epoch was planned, a phase and priorities were in force for which the best plan also leaves the function
  out, or is no better than the plan of the epoch.

A function may also fall silent while the module that serves it moves. The new PE of the module holds back its outputs
until ALIVE names the PE (protocol rule 6), and a manager that falls silent right after ACTIVATE sends no ALIVE. This is
allowed whatever the reason for the move is, for example that the operator's script begins or ends.

A run in which a fault was injected into anything but managers is not verified.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import pairwise

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score, serving_modules
from heronry_dg.situation import Situation
from heronry_tools.recording.commanded import Epoch
from heronry_tools.runtime.witness import Outage, Witness
from heronry_tools.sim.faults.fault import MANAGERS
from heronry_tools.sim.oracles.safe_mode import is_critical
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.planning import best_at_all

_COMPARED = 6  # levels of a plan's value: classes A to D, utility, inputs

InForce = Callable[[int, int], Iterable[Situation]]
"""Gives the situations, with nothing down, for the phases and priorities in force between two times (ns)."""


class LeftOut:
    """Tells whether the activated epochs explain why a function is silent.

    They do if one of them rightly leaves the function out, or if the function moves to another PE.
    """

    def __init__(self, spec: Spec, epochs: Mapping[int, Epoch], in_force: InForce) -> None:
        """Begin with the activated epochs, by number; epochs that the caller adds later are used, too."""
        self._spec, self._epochs, self._in_force = spec, epochs, in_force

    def explains(self, outage: Outage, patience_ns: int) -> bool:
        """Tell whether the epochs explain an outage: one rightly leaves the function out, or the function moves.

        The function moves if two successive epochs serve it on different PEs. Only those epochs are considered that
        ran at some moment from the beginning of the outage until `patience_ns` later.

        patience_ns: the time after the function's last output within which it had to be heard again
        """
        running = [
            (epoch, epoch.configuration)
            for epoch in self._running(outage.from_ns, outage.from_ns + patience_ns)
            if epoch.configuration is not None
        ]
        if any(self._is_right(outage.function, epoch, configuration) for epoch, configuration in running):
            return True
        places = (_serving_pe(self._spec, configuration, outage.function) for _, configuration in running)
        return any(None not in both and both[0] != both[1] for both in pairwise(places))

    def _running(self, from_ns: int, to_ns: int) -> Iterator[Epoch]:
        """Yield the epochs that ran at any moment from `from_ns` to `to_ns`, the newest first.

        An epoch runs from its activation until a newer epoch is activated.
        """
        for epoch in sorted(self._epochs.values(), key=_begins_ns, reverse=True):
            if _begins_ns(epoch) <= to_ns:
                yield epoch
            if _begins_ns(epoch) <= from_ns:
                return

    def _is_right(self, function: str, epoch: Epoch, configuration: Configuration) -> bool:
        """Tell whether it is right that a configuration does not serve a function; False if it serves the function.

        It is right if the best plan does not serve the function either, or is no better than the configuration. It is
        enough that this holds for one phase and one set of priorities that were in force at some moment from the
        preparation to the activation of the epoch.
        """
        if _serves(self._spec, configuration, function):
            return False
        for now in self._in_force(epoch.prepared_ns, _begins_ns(epoch)):
            best = best_at_all(self._spec, now)
            value = score(self._spec, now, configuration, None)
            is_as_good = value.key()[:_COMPARED] >= best.objective.key()[:_COMPARED]
            if is_as_good or not _serves(self._spec, best.configuration, function):
                return True
        return False


def stopped_by_silence(
    spec: Spec, targets: Iterable[str], witness: Witness, span_ns: range, left_out: LeftOut
) -> list[Violation]:
    """Return a violation for each function that was silent, although it must be heard while only managers fail.

    targets: all targets into which faults were injected; if one of them is not a manager, nothing is verified
    witness: has the silences of all functions
    span_ns: begin and end of the time that is verified; a silence that began before does not count
    left_out: tells which silences the activated epochs explain; such a silence is no violation
    """
    if any(target not in MANAGERS for target in targets):
        return []
    story = "was not heard, though only managers had failed"
    keeps = spec.manager.without_manager == "keep"
    promised = {function for function in spec.functions if keeps or is_critical(spec, function)}
    silent = [o for o in witness.outages(span_ns.stop) if o.function in promised and o.from_ns >= span_ns.start]
    return [
        Violation(o.from_ns + witness.patience_ns(o.function), "silence", f"{o.function} {story}", o.from_ns)
        for o in silent
        if not left_out.explains(o, witness.patience_ns(o.function))
    ]


def _begins_ns(epoch: Epoch) -> int:
    return epoch.prepared_ns if epoch.activated_ns is None else epoch.activated_ns


def _serving_pe(spec: Spec, configuration: Configuration, function: str) -> str | None:
    for one, module in serving_modules(spec, configuration):
        if one.name == function and module is not None:
            return configuration.modules[module].pe
    return None


def _serves(spec: Spec, configuration: Configuration, function: str) -> bool:
    return _serving_pe(spec, configuration, function) is not None
