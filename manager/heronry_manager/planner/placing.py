"""The first variables of the model (which module runs in which mode on which PE), and the rules on these variables.

There is one boolean variable for each possible (module, mode, PE). `on` (per module and mode), `at` (per module
and PE) and `runs` (per module) are sums of these variables; a sum with one term is that variable itself.

This part of the model ensures these rules of docs/semantics.md, section 3:

    semantics rule 1   place: for a PE that cannot run a mode, there is no variable of this mode
    semantics rule 4   of one DEMUX, at most one branch runs, and at most one end
    semantics rule 7   CPU, memory and flash of each PE
    semantics rule 8   placement rules
    semantics rule 10  of the modules that drive one actuator, at most one runs
"""

from collections.abc import Collection, Iterable, Iterator

from heronry_dg.configuration import Configuration
from heronry_manager.planner.candidates import Candidate, Candidates
from heronry_manager.planner.cp_sat import CpModel, IntVar, LinearExpr

Terms = list[tuple[IntVar, int]]


def weighted(terms: Iterable[tuple[IntVar, int]]) -> LinearExpr:
    """Return the weighted sum of literals."""
    literals, weights = [], []
    for literal, weight in terms:
        literals.append(literal)
        weights.append(weight)
    return LinearExpr.weighted_sum(literals, weights)


class Choice:
    """A part of a solver's model: variables that say which modules run, and in which mode.

    Subclasses create the variables.
    """

    def __init__(self, model: CpModel, possible: Candidates) -> None:
        """Begin without variables and constraints."""
        self.possible = possible
        self.on: dict[tuple[str, str], IntVar] = {}
        self.runs: dict[str, IntVar] = {}
        self._model = model

    def in_modes(self, module: str, modes: Collection[str]) -> list[IntVar]:
        """Return literals of which exactly one is true if `module` runs in one of `modes`; otherwise none is."""
        if len(modes) == len(self.possible.modules[module].hosts):
            return [self.runs[module]]
        return [self.on[module, mode] for mode in modes]

    def _sum(self, literals: list[IntVar], name: str) -> IntVar:
        if len(literals) == 1:
            return literals[0]
        result = self._model.new_bool_var(name)
        self._model.add(LinearExpr.sum(literals) == result)
        return result

    def _one_of_rivals(self) -> None:
        for rivals in self.possible.spec.rivals():
            self._model.add_at_most_one(self.runs[module] for module in rivals if module in self.runs)

    def _fits_in(self, pes: Collection[str], modes: Iterable[tuple[str, str]], modules: Iterable[str]) -> None:
        """Add a constraint: these modes, and the code of these modules, fit into all resources of `pes` together."""
        spec, cpu_millis = self.possible.spec, self.possible.left.pe_cpu_millis
        taken = [(spec.modules[module].modes[mode], self.on[module, mode]) for module, mode in modes]
        self._at_most([(literal, mode.cpu_millis) for mode, literal in taken], sum(cpu_millis[pe] for pe in pes))
        self._at_most([(literal, mode.ram) for mode, literal in taken], sum(spec.pes[pe].ram for pe in pes))
        stored = [(self.runs[module], spec.modules[module].flash) for module in modules]
        self._at_most(stored, sum(spec.pes[pe].flash for pe in pes))

    def _at_most(self, terms: Terms, capacity: int) -> None:
        if sum(weight for _, weight in terms) > capacity:
            self._model.add(weighted(terms) <= capacity)


class Placing(Choice):
    """The variables of the solver's model that say which modules run, each in which mode and on which PE."""

    def __init__(self, model: CpModel, possible: Candidates) -> None:
        """Add to the model which module runs in which mode on which PE, as variables and their constraints."""
        super().__init__(model, possible)
        self.pes = {name: candidate.pes() for name, candidate in possible.modules.items()}
        self.x: dict[tuple[str, str, str], IntVar] = {}
        self.at: dict[tuple[str, str], IntVar] = {}
        for name, candidate in possible.modules.items():
            self._add_module(name, candidate)
        self._one_of_rivals()
        self._capacities()
        self._fits_in(tuple(possible.left.pe_cpu_millis), self.on, self.runs)  # redundant; it gives a bound
        self._separate()
        self._together()

    def somewhere(self, module: str, pes: Collection[str]) -> list[IntVar] | None:
        """Return literals: exactly one is true if `module` runs on one of `pes`, and none if it runs elsewhere.

        None: all PEs on which the module can run are among `pes`.
        """
        hosts = self.pes[module]
        if all(pe in pes for pe in hosts):
            return None
        return [self.at[module, pe] for pe in hosts if pe in pes]

    def hint(self, configuration: Configuration) -> Iterator[tuple[IntVar, bool]]:
        """Yield each variable with the value that it has for this configuration."""
        runs = {name: (running.mode, running.pe) for name, running in configuration.modules.items()}
        for name, literal in self.runs.items():
            mode, pe = runs.get(name, (None, None))
            yield literal, mode is not None
            for other in self.possible.modules[name].hosts:
                yield self.on[name, other], other == mode
            for other in self.pes[name]:
                yield self.at[name, other], other == pe
        for (name, other, at), literal in self.x.items():
            yield literal, runs.get(name) == (other, at)

    def count_parts(self) -> None:
        """Add constraints that follow because a module is indivisible.

        A PE has no room for three modules that each need more than a third of its CPU. In this count, a module that
        needs more than two thirds counts as two. Nor has a PE room for four modules that each need more than a fourth.
        Here, a module that needs more than two fourths counts as two, and one that needs more than three fourths counts
        as three.

        The solver does not find these constraints by itself, because its linear relaxation fills the remaining room
        with a part of a module. The same constraint on halves is not needed: the solver finds it.
        """
        modules = self.possible.spec.modules
        for pe, capacity in self.possible.left.pe_cpu_millis.items():
            here = [
                (literal, modules[m].modes[mode].cpu_millis) for (m, mode, at), literal in self.x.items() if at == pe
            ]
            for parts in (3, 4):
                counted = [(literal, parts * cpu // (capacity + 1)) for literal, cpu in here]
                self._at_most([(literal, times) for literal, times in counted if times], parts - 1)

    def _add_module(self, name: str, candidate: Candidate) -> None:
        for mode, hosts in candidate.hosts.items():
            for pe in hosts:
                self.x[name, mode, pe] = self._model.new_bool_var(f"{name}.{mode}@{pe}")
            self.on[name, mode] = self._sum([self.x[name, mode, pe] for pe in hosts], f"{name}.{mode}")
        pes = self.pes[name]
        for pe in pes:
            modes = [self.x[name, mode, pe] for mode, hosts in candidate.hosts.items() if pe in hosts]
            self.at[name, pe] = self._sum(modes, f"{name}@{pe}")
        if len(pes) == 1:
            self.runs[name] = self.at[name, pes[0]]
        else:
            self.runs[name] = self._sum([self.on[name, mode] for mode in candidate.hosts], name)

    def _capacities(self) -> None:
        spec, left = self.possible.spec, self.possible.left
        for name, pe in spec.pes.items():
            if name not in left.pe_cpu_millis:
                continue
            here = [(key, literal) for key, literal in self.x.items() if key[2] == name]
            modes = [(spec.modules[module].modes[mode], literal) for (module, mode, _), literal in here]
            self._at_most([(literal, mode.cpu_millis) for mode, literal in modes], left.pe_cpu_millis[name])
            self._at_most([(literal, mode.ram) for mode, literal in modes], pe.ram)
            stored = [(literal, spec.modules[m].flash) for (m, host), literal in self.at.items() if host == name]
            self._at_most(stored, pe.flash)

    def _separate(self) -> None:
        for group in self.possible.spec.separate:
            for pe in self.possible.spec.pes:
                self._model.add_at_most_one(self._here(group, pe))

    def _together(self) -> None:
        """Require that all running modules of one group of `together` run on the same PE."""
        for number, group in enumerate(self.possible.spec.together):
            homes = {pe: self._here(group, pe) for pe in self.possible.spec.pes}
            chosen = {pe: self._model.new_bool_var(f"together.{number}@{pe}") for pe, here in homes.items() if here}
            self._model.add_at_most_one(chosen.values())
            for pe, home in chosen.items():
                for literal in homes[pe]:
                    self._model.add_implication(literal, home)

    def _here(self, group: Collection[str], pe: str) -> list[IntVar]:
        return [self.at[module, pe] for module in group if (module, pe) in self.at]
