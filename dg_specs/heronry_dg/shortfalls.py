"""What is less than the best upstream of an output: lesser modes, missing optional inputs, lesser versions.

A function counts as served when its output module runs, and its value is that of this module's mode. But the modules
that supply the output, directly or through others, may run in lesser modes, or without optional inputs. This file finds
them by the wires of a configuration, from the output upwards; in a cycle each module is looked at once.

An input of a XOR that is not chosen is not missing, and neither is an input that the phase closes (`only_in`).
"""

from collections import deque
from collections.abc import Collection, Iterator

from heronry_dg.configuration import Configuration
from heronry_dg.gates import Expression, Leaf, Or, child_path, holds, leaves
from heronry_dg.model import Function, Spec
from heronry_dg.plan import Plan


def shortfalls(spec: Spec, configuration: Configuration, output: str, phase: str | None) -> tuple[str, ...]:
    """Return a sentence for everything less than the best in an output module and upstream of it, nearest first.

    output: a module that runs in the configuration. phase: the mission phase; None: the spec has no phases.
    """
    found: list[str] = []
    waiting, seen = deque([output]), {output}
    while waiting:
        module = waiting.popleft()
        found += _of_module(spec, configuration, module, phase)
        for wire in configuration.modules[module].inputs.values():
            if wire.producer not in seen and wire.producer in configuration.modules:
                seen.add(wire.producer)
                waiting.append(wire.producer)
    return tuple(found)


def shortfalls_of(spec: Spec, plan: Plan, function: Function) -> tuple[str, ...]:
    """Return the shortfalls of the output with which a plan serves a function; none if the plan does not serve it."""
    running = plan.configuration
    serving = next((output for output in function.outputs if output in running.modules), None)
    if serving is None or not plan.functions[function.name].served:
        return ()
    return shortfalls(spec, running, serving, plan.now.phase)


def _of_module(spec: Spec, configuration: Configuration, module: str, phase: str | None) -> Iterator[str]:
    running, best = configuration.modules[module], next(iter(spec.modules[module].modes))
    if running.mode != best:
        yield f"{module} runs in mode {running.mode}, not {best}"
    mode = configuration.mode(spec, module)
    if mode.needs is not None:
        leaves_missing = _missing(mode.needs, running.inputs.keys(), phase)
        missing = dict.fromkeys(_written(leaf, spec.variables[leaf.variable].versions) for leaf in leaves_missing)
        if missing:
            yield f"{module} runs without {', '.join(missing)}"
    best_of: dict[str, int] = {}
    for _, leaf in mode.leaves():
        best_of[leaf.variable] = min(leaf.best, best_of.get(leaf.variable, leaf.best))
    wired: dict[str, int] = {}
    for wire in running.inputs.values():
        wired[wire.variable] = min(wire.version, wired.get(wire.variable, wire.version))
    lesser = [f"{name}@{version}" for name, version in wired.items() if version > best_of.get(name, version)]
    if lesser:
        yield f"{module} reads {', '.join(lesser)}"


def _missing(needs: Expression, wired: Collection[str], phase: str | None, path: str = "") -> Iterator[Leaf]:
    """Yield the leaves of each input of an OR that does not hold; inputs that the phase closes are left out."""
    if isinstance(needs, Leaf):
        return
    for index, child in enumerate(needs.inputs):
        below = child_path(path, index)
        if holds(child, wired, below):
            yield from _missing(child, wired, phase, below)
        elif isinstance(needs, Or):
            own = [leaf for _, leaf in leaves(child)]
            if all(leaf.is_open_in(phase) for leaf in own):
                yield from own


def _written(leaf: Leaf, versions: int) -> str:
    if (leaf.best, leaf.worst) == (1, versions):
        return leaf.variable
    return f"{leaf.variable}@{leaf.worst}" if leaf.best == leaf.worst else f"{leaf.variable}@<={leaf.worst}"
