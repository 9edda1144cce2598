"""Checks the paths behind the DEMUXes of a spec: which branch leads to which end.

A branch of a DEMUX may be the first of several modules on the way to an actuator. Then the DEMUX names in `to` the
modules at which its paths end, and a function is served only when such an end runs. This file decides which modules
*belong* to a branch (docs/semantics.md, section 2): modules that can run, but cannot run without the branch.

The set of what can run is computed as if all elements were up and resources were unlimited. It is the greatest set of
pairs (module, mode) that has two properties:

    - each module of the set can be placed on a PE
    - the needs of each mode can be met by data from modes of the set. So modules that feed one another in a cycle can
      be in the set

The search begins with all modes, and removes modes one by one. If a removal leaves no mode that gives a datum, the
readers of this datum are checked once more. So the search takes at most a few passes over the spec for each branch.

Whether a path fits the PEs and buses is checked by the planner, and not here.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from heronry_dg import yaml_source
from heronry_dg.draft import Draft
from heronry_dg.findings import Findings, listed
from heronry_dg.gates import Leaf, could_hold
from heronry_dg.model import Demux, Mode, Module, Spec
from heronry_dg.rules import graph as rules
from heronry_dg.rules.rule import Rule
from heronry_dg.situation import hosts_when_all_is_up

_Datum = tuple[str, int]  # variable, version


@dataclass(frozen=True, slots=True)
class EndMistake:
    """A mistake in the paths behind a DEMUX.

    path: the place of the mistake below the DEMUX in the file; () for the DEMUX itself.
    """

    demux: str
    rule: Rule
    path: tuple[str | int, ...]
    sentence: str
    hint: str


def check_demux_paths(draft: Draft, spec: Spec, findings: Findings) -> None:
    """Add a finding for each mistake in the paths behind the DEMUXes of a spec."""
    for mistake in end_mistakes(spec):
        element = draft.demuxes[mistake.demux]
        place = yaml_source.place_at(element.node, mistake.path) if mistake.path else element.place
        findings.add(mistake.rule, place, mistake.sentence, mistake.hint)


def end_mistakes(spec: Spec) -> Iterator[EndMistake]:
    """Check the key `to` of each DEMUX, and find each DEMUX that should have this key and does not.

    The key must name one end for each branch. An end that drives no actuator must not lead on to one that does.
    A DEMUX should have the key if it is the output of a function, and one of its branches drives no actuator, but
    leads on to modules that drive one.
    """
    outputs = {function.output for function in spec.functions.values()}
    asked = [demux for demux in spec.demuxes.values() if demux.to or (demux.name in outputs and _bare(spec, demux))]
    if not asked:
        return
    paths = DemuxPaths(spec)
    for demux in asked:
        yield from _wrong_ends(paths, demux) if demux.to else _missing_ends(paths, demux)


def _wrong_ends(paths: "DemuxPaths", demux: Demux) -> Iterator[EndMistake]:
    """Find what is wrong with `to` of a DEMUX, which must name one end for each branch.

    An end is wrong if it can never run, if it belongs to no branch, to several, or to the branch of another end, or if
    it drives no actuator although another module of its branch does.
    """
    hint = "name one end for each branch: a module that can run only if that branch does"
    if len(demux.to) != len(demux.branches):
        sentence = f"DEMUX '{demux.name}' has {len(demux.branches)} branches, and 'to' names {len(demux.to)} modules"
        sentence = f"{sentence}: {listed(demux.branches)}"
        yield EndMistake(demux.name, rules.DEMUX_ENDS, ("to",), sentence, hint)
        return
    end_of: dict[str, str] = {}
    for index, end in enumerate(demux.to):
        owners = [branch for branch in demux.branches if paths.belongs(end, branch)]
        sentence = ""
        if not paths.can_run(end):
            sentence = f"'{end}' cannot be an end: it never runs"
        elif len(owners) != 1:
            which = listed(owners, last="and") if owners else "no branch"
            sentence = f"'{end}' cannot be an end: it depends on {which} of the DEMUX"
        elif (other := end_of.setdefault(owners[0], end)) != end:
            sentence = f"'{other}' and '{end}' are both ends of branch '{owners[0]}'"
        elif further := _actuators_beyond(paths, end, owners[0]):
            sentence = f"'{end}' cannot be an end: it drives no actuator, and leads on to {listed(further)}"
            hint = (
                "name the module that drives the actuator; instead of a cascade, write one DEMUX with a branch for each"
            )
        if sentence:
            yield EndMistake(demux.name, rules.DEMUX_ENDS, ("to", index), sentence, hint)


def _actuators_beyond(paths: "DemuxPaths", end: str, branch: str) -> list[str]:
    """Return the modules of a branch that drive an actuator, if its end drives none."""
    spec = paths.spec
    if _drives(spec, spec.modules[end]):
        return []
    return [name for name, module in spec.modules.items() if _drives(spec, module) and paths.belongs(name, branch)]


def _missing_ends(paths: "DemuxPaths", demux: Demux) -> Iterator[EndMistake]:
    """Check a DEMUX that has no `to`.

    It needs `to` if one of its branches drives no actuator, but leads on to modules that drive one. The first such
    branch is reported.
    """
    actuators = [name for name, module in paths.spec.modules.items() if _drives(paths.spec, module)]
    lost = [name for name in actuators if not paths.can_run(name, without=demux.branches)]
    for branch in _bare(paths.spec, demux):
        reached = paths.reached_from(branch)
        ends = [name for name in lost if name in reached] or [m for m in actuators if paths.belongs(m, branch)]
        if ends:
            sentence = f"branch '{branch}' of DEMUX '{demux.name}' drives no actuator, and leads on to {listed(ends)}"
            hint = "name under 'to' the module at which each branch ends, the preferred one first"
            yield EndMistake(demux.name, rules.DEMUX_WITHOUT_ENDS, (), sentence, hint)
            return


def _bare(spec: Spec, demux: Demux) -> list[str]:
    """Branches of a DEMUX that drive no actuator."""
    return [branch for branch in demux.branches if not _drives(spec, spec.modules[branch])]


def _drives(spec: Spec, module: Module) -> bool:
    return module.device is not None and spec.devices[module.device].kind == "actuator"


class DemuxPaths:
    """Tells which modules of a spec can run at all, and which of them depend on a branch of a DEMUX."""

    def __init__(self, spec: Spec) -> None:
        """Compute what can run when no module has failed."""
        self.spec = spec
        self._readers: dict[_Datum, list[tuple[Module, Mode]]] = {}
        for module in spec.modules.values():
            for mode in module.modes.values():
                for datum in {datum for _, leaf in mode.leaves() for datum in _accepted(leaf)}:
                    self._readers.setdefault(datum, []).append((module, mode))
        every = [(module, mode) for module in spec.modules.values() for mode in module.modes.values()]
        homeless = [module.name for module in spec.modules.values() if not hosts_when_all_is_up(spec, module)]
        givers = Counter(datum for _, mode in every for datum in mode.gives.items())
        self._whole = _Remains({(module.name, mode.name) for module, mode in every}, givers)
        self._remove(self._whole, homeless, every)
        self._without: dict[frozenset[str], _Remains] = {frozenset(): self._whole}

    def can_run(self, module: str, *, without: Collection[str] = ()) -> bool:
        """Tell whether some mode of a module can run if the modules in `without` have failed."""
        remains = self._remaining(frozenset(without))
        return any((module, mode) in remains.modes for mode in self.spec.modules[module].modes)

    def belongs(self, module: str, branch: str) -> bool:
        """Tell whether a module can run if no module has failed, but cannot run if this branch has failed."""
        return self.can_run(module) and not self.can_run(module, without=(branch,))

    def reached_from(self, module: str) -> set[str]:
        """Modules to which a module gives data, directly or through others, in any modes."""
        reached, waiting = set[str](), [module]
        while waiting:
            for mode in self.spec.modules[waiting.pop()].modes.values():
                for datum in mode.gives.items():
                    new = {reader.name for reader, _ in self._readers.get(datum, ())} - reached
                    reached |= new
                    waiting += new
        return reached

    def _remaining(self, failed: frozenset[str]) -> "_Remains":
        if failed not in self._without:
            remains = _Remains(self._whole.modes, self._whole.givers)
            self._remove(remains, failed, ())
            self._without[failed] = remains
        return self._without[failed]

    def _remove(self, remains: "_Remains", failed: Iterable[str], doubtful: Iterable[tuple[Module, Mode]]) -> None:
        """Remove the modes of failed modules, then all modes whose needs can no longer be met.

        doubtful: modes to check first, since it is not known whether their needs can be met.
        """
        falling = [
            (self.spec.modules[name], mode) for name in failed for mode in self.spec.modules[name].modes.values()
        ]
        falling += [(module, mode) for module, mode in doubtful if not remains.feed(mode)]
        while falling:
            module, mode = falling.pop()
            if (module.name, mode.name) not in remains.modes:
                continue
            remains.modes.remove((module.name, mode.name))
            for datum in mode.gives.items():
                remains.givers[datum] -= 1
                if not remains.givers[datum]:
                    falling += [(one, its) for one, its in self._readers.get(datum, ()) if not remains.feed(its)]


class _Remains:
    """The modes that can still run, and for each datum the number of these modes that give it."""

    def __init__(self, modes: Collection[tuple[str, str]], givers: Counter[_Datum]) -> None:
        self.modes = set(modes)
        self.givers = Counter(givers)

    def feed(self, mode: Mode) -> bool:
        """Tell whether the modules that still give data can meet the needs of a mode."""
        return mode.needs is None or could_hold(
            mode.needs, lambda leaf: any(self.givers[d] > 0 for d in _accepted(leaf))
        )


def _accepted(leaf: Leaf) -> list[_Datum]:
    return [(leaf.variable, version) for version in range(leaf.best, leaf.worst + 1)]
