"""The safe mode of a phase: the configuration of its critical functions only, with the fewest changes.

A PE without a manager falls back to the safe mode (`without_manager: safe_mode`). So the safe mode should be small, and
similar to the running configuration. It is planned with a reduced spec: functions of class E are not wanted, all modes
are equally good, and optional inputs earn no points. Then the critical classes decide first, and next the fewest
changes against the phase's fault-free plan. The outputs of class E stop, unless a critical function cannot be served
without them.
"""

from collections.abc import Mapping
from dataclasses import replace

from heronry_dg.configuration import Configuration
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.gates import Leaf, with_leaves
from heronry_dg.model import Function, Mode, Module, Spec
from heronry_dg.objective import Placement, score
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation
from heronry_manager.planner.candidates import candidates
from heronry_manager.planner.exact import DEFAULT_EFFORT, Search


def safe_mode(spec: Spec, phase: str | None, running: Placement) -> Configuration:
    """Find the safe mode of a phase: the configuration of its critical functions with the fewest changes.

    running: the phase's fault-free placement, against which the changes are counted.
    """
    reduced = _critical_alone(spec, phase)
    wanted = {output for function in reduced.functions.values() for output in function.outputs}
    luxuries = {output for function in spec.functions.values() for output in function.outputs} - wanted
    plain, whole = (
        _best(spec, reduced, Situation(frozenset(down), phase=phase), running)
        for down in ([f"module:{name}" for name in luxuries], [])
    )
    now = Situation(phase=phase)
    served_alike = score(spec, now, plain, None).critical == score(spec, now, whole, None).critical
    return plain if served_alike else whole


def _best(spec: Spec, reduced: Spec, now: Situation, running: Placement) -> Configuration:
    """Find the best configuration of the reduced spec in the situation `now`.

    spec: the whole spec; deadlines are checked with its identifiers.
    running: the placement against which changes are counted.
    """
    search = Search(candidates(reduced, now), running, ResponseTimes(spec), DEFAULT_EFFORT)
    search.run()
    return search.best


def _critical_alone(spec: Spec, phase: str | None) -> Spec:
    functions = {
        name: replace(function, value=(0,) * _most_modes(spec, function))
        for name, function in spec.functions.items()
        if function.criticality_in(phase) != CRITICALITIES[-1]
    }
    return replace(spec, functions=functions, modules=_without_worth(spec.modules))


def _most_modes(spec: Spec, function: Function) -> int:
    return max(len(spec.modules[output].modes) for output in function.outputs)


def _without_worth(modules: Mapping[str, Module]) -> dict[str, Module]:
    return {
        name: replace(module, modes={mode.name: _plain(mode) for mode in module.modes.values()})
        for name, module in modules.items()
    }


def _plain(mode: Mode) -> Mode:
    return mode if mode.needs is None else replace(mode, needs=with_leaves(mode.needs, _worthless))


def _worthless(leaf: Leaf) -> Leaf:
    return replace(leaf, worth=(0,) * len(leaf.worth))
