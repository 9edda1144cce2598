"""The part of the solver's model about wires: which producer feeds each input, the gates, the purpose of modules.

*Wires*. Each (consumer, mode, leaf, source) has a literal, which is true if this wire is in use.

*Gates*. All inputs of an AND must hold, so they need no variables that say whether they hold. Each input of
another gate (an OR or a XOR) needs such a variable; for a leaf, those of its wires serve. A gate is built by
two methods; `above` is the literal of the mode or of the gate to which the gate belongs:

    _require   builds a gate that must hold if `above` is true. If `above` is false, nothing below the gate is
               wired
    _offer     builds an input that may hold while `above` is true. It returns literals: if the input holds,
               exactly one of them is true

A leaf that must hold, with only one possible source, needs no variable: the literal of its wire is `above` itself.

A gate of the kind 0-of-n holds with nothing wired below it. So both values of its literal mean the same
configuration. This does no harm, since the loader allows no such gate in a XOR.

*Purpose* (semantics rule 5). A module that serves no function by itself must feed a module that has a purpose.
Modules that feed each other in a circle must not get their purpose from each other alone. So the model has
ranks: each module has a higher rank than some module that it feeds. Only modules on such circles have ranks
(strongly connected components of the relation "could feed").
"""

from collections.abc import Iterable, Iterator

from heronry_dg.configuration import Configuration
from heronry_dg.cycles import components
from heronry_dg.gates import Expression, Leaf, bounds, child_path
from heronry_manager.planner.candidates import Candidates, Source
from heronry_manager.planner.cp_sat import CpModel, IntVar, LinearExpr
from heronry_manager.planner.placing import Choice

Link = tuple[str, str, str]  # consumer, producer, variable


class Wiring:
    """The variables of the solver's model that say which producer feeds each input."""

    def __init__(self, model: CpModel, possible: Candidates, choice: Choice) -> None:
        """Add to the model the variables of the wires, and the constraints of semantics rules 2, 3 and 5.

        choice: the variables of the model that say which modules run, and in which modes.
        """
        self.wires: dict[tuple[str, str, str], list[tuple[Source, Leaf, IntVar]]] = {}
        self.links: dict[Link, list[IntVar]] = {}  # at most one of the literals is true
        self._forced: set[tuple[str, str, str]] = set()  # inputs with one possible source
        self._model = model
        self._possible = possible
        self._choice = choice
        for name, candidate in possible.modules.items():
            for mode in candidate.modes():
                if mode.needs is not None:
                    self._require(mode.needs, (name, mode.name, ""), choice.on[name, mode.name])
        self._producers_run()
        self._purpose()

    def hint(self, configuration: Configuration) -> Iterator[tuple[IntVar, bool]]:
        """Yield each wire's variable with the value that the variable has for this configuration.

        Left out are wires that have no variable of their own, and the variables of gates and ranks: the solver
        finds the values of these variables itself.
        """
        for (consumer, mode, path), wires in self.wires.items():
            running = configuration.modules.get(consumer)
            wire = running.inputs.get(path) if running is not None and running.mode == mode else None
            for source, _, literal in wires:
                if (consumer, mode, path) not in self._forced:
                    yield literal, wire is not None and (wire.producer, wire.version) == (source.module, source.version)

    def _require(self, gate: Expression, where: tuple[str, str, str], above: IntVar) -> None:
        if isinstance(gate, Leaf):
            self._wire(gate, where, above)
            return
        fewest, most = bounds(gate)
        if fewest == len(gate.inputs):
            for index, child in enumerate(gate.inputs):
                self._require(child, _below(where, index), above)
            return
        offers = [self._offer(child, _below(where, i), above) for i, child in enumerate(gate.inputs)]
        held = LinearExpr.sum([literal for offer in offers for literal in offer])
        if fewest == most:
            self._model.add(held == fewest * above)
            return
        if fewest > 0:
            self._model.add(held >= fewest * above)
        if most < len(gate.inputs):
            self._model.add(held <= most * above)

    def _offer(self, gate: Expression, where: tuple[str, str, str], above: IntVar) -> list[IntVar]:
        if isinstance(gate, Leaf):
            return self._offer_leaf(gate, where, above)
        held = self._model.new_bool_var(f"{where[0]}.{where[1]}[{where[2]}]")
        self._model.add_implication(held, above)
        self._require(gate, where, held)
        return [held]

    def _wire(self, leaf: Leaf, where: tuple[str, str, str], above: IntVar) -> None:
        """Add constraints: a leaf is wired to exactly one source while `above` is true, and to none otherwise.

        where: module, mode and path of the leaf.
        """
        sources = self._possible.sources(where[0], where[1], leaf)
        if len(sources) == 1:
            self._forced.add(where)
            self._register(leaf, where, [(sources[0], above)])
            return
        self._model.add(LinearExpr.sum(self._new_wires(leaf, where, sources)) == above)

    def _offer_leaf(self, leaf: Leaf, where: tuple[str, str, str], above: IntVar) -> list[IntVar]:
        """Add constraints: a leaf is wired to at most one source while `above` is true, and to none otherwise.

        Return one literal for each source, which is true if the leaf is wired to this source.

        where: module, mode and path of the leaf.
        """
        made = self._new_wires(leaf, where, self._possible.sources(where[0], where[1], leaf))
        if made:
            self._model.add(LinearExpr.sum(made) <= above)
        return made

    def _new_wires(self, leaf: Leaf, where: tuple[str, str, str], sources: Iterable[Source]) -> list[IntVar]:
        wires = [(s, self._model.new_bool_var(f"{where[0]}.{where[1]}[{where[2]}]<-{s.module}")) for s in sources]
        self._register(leaf, where, wires)
        return [literal for _, literal in wires]

    def _register(self, leaf: Leaf, where: tuple[str, str, str], wires: list[tuple[Source, IntVar]]) -> None:
        self.wires[where] = [(source, leaf, literal) for source, literal in wires]
        for source, literal in wires:
            self.links.setdefault((where[0], source.module, leaf.variable), []).append(literal)

    def _producers_run(self) -> None:
        """Add constraints: the producer of each wire runs in a mode that gives the wire's version (semantics rule 2).

        One constraint is enough for each consumer and each version of a producer's variable. It is about the sum of the
        literals of all possible wires from this version to this consumer: at most 1 if the producer runs in a mode that
        gives this version, and otherwise 0. More than one of these wires is never in use, because a consumer runs in
        one mode, and inputs of one mode that take the same variable accept different versions.
        """
        alike: dict[tuple[str, Source, str], list[IntVar]] = {}
        for (consumer, _, _), wires in self.wires.items():
            for source, leaf, literal in wires:
                alike.setdefault((consumer, source, leaf.variable), []).append(literal)
        for (consumer, source, _), literals in alike.items():
            if consumer != source.module:
                giving = self._choice.in_modes(source.module, source.modes)
                self._model.add(LinearExpr.sum(literals) <= LinearExpr.sum(giving))

    def _purpose(self) -> None:
        idle = [name for name in self._possible.modules if name not in self._possible.wanted]
        feeds: dict[str, dict[str, list[IntVar]]] = {name: {} for name in self._possible.modules}
        for (consumer, producer, _), literals in self.links.items():
            if consumer != producer:
                feeds[producer].setdefault(consumer, []).extend(literals)
        rank = {name: number for number, name in enumerate(idle)}
        circles = components({name: [c for c in feeds[name] if c in idle] for name in idle})
        circles.sort(key=lambda circle: rank[circle[0]])
        ranks = {
            name: self._model.new_int_var(0, len(circle) - 1, f"rank of {name}")
            for circle in circles
            if len(circle) > 1
            for name in circle
        }
        circle_of = {name: number for number, circle in enumerate(circles) for name in circle}
        for name in idle:
            support: list[IntVar] = []
            for consumer, literals in feeds[name].items():
                if circle_of.get(consumer) == circle_of[name]:
                    support.append(self._ranked(name, consumer, literals, ranks))
                else:
                    support.extend(literals)
            self._model.add(LinearExpr.sum(support) >= self._choice.runs[name])

    def _ranked(self, name: str, consumer: str, literals: list[IntVar], ranks: dict[str, IntVar]) -> IntVar:
        """Return a literal that is true only if `consumer` reads from `name` and has a lower rank than `name`.

        name, consumer: modules. literals: the wires from `name` to `consumer`. ranks: module -> its rank.
        """
        supports = self._model.new_bool_var(f"{name} serves through {consumer}")
        self._model.add(LinearExpr.sum(literals) >= supports)
        self._model.add(ranks[name] >= ranks[consumer] + 1).only_enforce_if(supports)
        return supports


def _below(where: tuple[str, str, str], index: int) -> tuple[str, str, str]:
    return where[0], where[1], child_path(where[2], index)
