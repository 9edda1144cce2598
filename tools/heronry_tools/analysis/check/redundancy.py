"""The check of DG410 to DG412: elements on which all alternatives depend. The check uses the graph, and no solver.

*Alternatives* are the inputs of a XOR or a voter, or the ends of a DEMUX. A voter is an OR of which at least two
inputs, but not all, must hold. An expression *depends on* an element when it cannot hold without that element, even
with unlimited resources (`heronry_dg.why_not` computes this). Alternatives that all depend on one element give no
protection from its faults.

Two kinds of elements do not count:

- an element whose loss also stops the module that reads the alternatives, since then no module needs them;
- the manager's bus, without which nothing runs at all.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from heronry_dg.findings import listed
from heronry_dg.gates import Expression, Gate, Leaf, bounds, child_path, leaves
from heronry_dg.model import Demux, Mode, Module, Spec
from heronry_dg.situation import Situation, elements
from heronry_dg.why_not import Feasibility, Feasible

INDEPENDENT_SOURCES = 3
_NEVER_LOST = 10**9  # a round of the search for losses that comes after all others


@dataclass(frozen=True, slots=True)
class Alternatives:
    """A XOR or a voter among the gates of a mode.

    path: the path of the gate in the mode's `needs`.
    inputs: for each input of the gate, the elements on which this input depends.
    """

    gate: Gate
    path: str
    inputs: Sequence[frozenset[str]]

    @property
    def is_choice(self) -> bool:
        """Tell whether exactly one input is used at a time; if not, several inputs vote."""
        return bounds(self.gate)[1] == 1


class Dependence:
    """Finds the elements on which all ends of a DEMUX depend, and those on which each input of a gate depends."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        hopeless = f"bus:{spec.manager.bus}"
        named = [one for one in elements(spec) if one != hopeless and not one.startswith("channel:")]
        feasibility = Feasibility(spec, None)
        self._healthy = feasibility.in_situation(Situation())
        self._without: dict[str, Feasible] = {}
        self._lost_with: dict[tuple[str, str], list[str]] = {}  # (module, mode) -> elements without which it cannot run
        for element in named:
            found = self._without[element] = feasibility.in_situation(Situation(frozenset({element})))
            for lost in found.lost:
                self._lost_with.setdefault(lost, []).append(element)

    def of_ends(self, demux: Demux) -> frozenset[str]:
        """Return the elements whose loss stops all ends of a DEMUX, but leaves all that the DEMUX needs.

        The set is empty if some end cannot run even with everything up.
        """
        ends = [self.spec.modules[name] for name in demux.ends]
        if not all(self._healthy.can_run(end) for end in ends):
            return frozenset()
        suspects = self._losing((end.name, mode) for end in ends for mode in end.modes)
        unserved = self._where(suspects, lambda found: not any(found.can_run(end) for end in ends))
        return unserved - self._where(unserved, lambda found: not found.can_hold(demux.needs, _NEVER_LOST))

    def alternatives(self, module: Module, mode: Mode) -> Iterator[Alternatives]:
        """Yield each XOR and each voter among the gates of a mode.

        A gate is left out if at least one of its inputs cannot hold by itself even with nothing down.
        """
        for path, gate in _gates(mode.needs):
            if _chooses(gate) and all(self._healthy.can_hold(one, _NEVER_LOST) for one in gate.inputs):
                yield Alternatives(gate, path, [self._of(one, module) for one in gate.inputs])

    def shown(self, shared: frozenset[str]) -> str:
        """List the shared elements as text, each with its kind and name.

        If a device is shared, its PE and the module that is its driver are left out, since they are implied.
        """
        spec = self.spec
        implied = {f"pe:{device.pe}" for device in spec.devices.values() if f"device:{device.name}" in shared}
        implied |= {f"module:{m.name}" for m in spec.modules.values() if f"device:{m.device}" in shared}
        named = [one.partition(":") for one in elements(spec) if one in shared - implied]
        return listed(f"{kind} '{name}'" for kind, _, name in named)

    def _of(self, needs: Expression, reader: Module) -> frozenset[str]:
        """Return the elements whose loss keeps an expression from holding, but leaves a PE that can run `reader`.

        reader: the module that has the expression.
        """
        givers = (giver for _, leaf in leaves(needs) for giver in self._healthy.givers(leaf))
        suspects = self._losing((giver.name, mode.name) for giver, mode in givers)
        silent = self._where(suspects, lambda found: not found.can_hold(needs, _NEVER_LOST))
        return silent - self._where(silent, lambda found: not found.left.hosts(reader))

    def _losing(self, modes: Iterable[tuple[str, str]]) -> frozenset[str]:
        """Return the elements without which at least one of these modes (module, mode) cannot run."""
        return frozenset(element for mode in modes for element in self._lost_with.get(mode, ()))

    def _where(self, suspects: frozenset[str], lost: Callable[[Feasible], bool]) -> frozenset[str]:
        return frozenset(element for element in suspects if lost(self._without[element]))


def _chooses(gate: Gate) -> bool:
    """Tell whether a gate is a XOR, or a vote in which at least two inputs have to hold, but not all inputs."""
    fewest, most = bounds(gate)
    return 1 <= fewest < len(gate.inputs) and (most == 1 or fewest >= 2)


def independent(inputs: Sequence[frozenset[str]]) -> int:
    """Return the largest number of inputs, up to three, of which no two depend on the same element."""

    def most(left: Sequence[frozenset[str]], wanted: int) -> int:
        best = 0
        for index, one in enumerate(left):
            if best < wanted:
                best = max(best, 1 + most([other for other in left[index + 1 :] if not one & other], wanted - 1))
        return min(best, wanted)

    return most(inputs, INDEPENDENT_SOURCES)


def shared_pair(inputs: Sequence[frozenset[str]]) -> tuple[int, int]:
    """Return the indices of the first two inputs that depend on the same element; there must be two such inputs."""
    return next(
        (first, second)
        for first in range(len(inputs))
        for second in range(first + 1, len(inputs))
        if inputs[first] & inputs[second]
    )


def _gates(needs: Expression | None, path: str = "") -> Iterator[tuple[str, Gate]]:
    """Yield every gate of an expression, with the path of the gate.

    The path has the index of each input on the way to the gate, for example `0.2`. It is empty for the outermost gate.
    """
    if needs is None or isinstance(needs, Leaf):
        return
    yield path, needs
    for index, child in enumerate(needs.inputs):
        yield from _gates(child, child_path(path, index))
