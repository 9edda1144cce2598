"""What a check asks the planner: whether some functions can all be served, and which ones a phase's plan gives up.

The exact planner answers both questions. It first gets a cheap problem: only the functions in question are wanted, all
with the same priority. If they can all be served together, no plan of the phase is needed: every best plan of the phase
serves them, provided that the phase wants no other critical function. If they cannot all be served, the whole phase is
planned, with its priorities.

Identifiers, and with them response times, are always taken from the whole spec, as they are used on the bus.
"""

from collections.abc import Collection, Mapping, Set
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Final

from heronry_dg.configuration import Configuration
from heronry_dg.losses import lost_of, used_elements
from heronry_dg.model import Function, Spec
from heronry_dg.objective import placement, serving_modules, value_of
from heronry_dg.plan import Plan
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import contributors, feeders
from heronry_manager.planner.candidates import Candidates, candidates
from heronry_manager.planner.exact import Search, plan

Phase = str | None
_EFFORT: Final = (
    5.0  # deterministic seconds for one question; a question about a shipped spec takes a hundredth of this
)
_NO_DEADLINE_NS: Final = 10**18
PLENTY: Final = 10**12
NOTHING_ASKED: Final[Mapping[str, int]] = MappingProxyType({})
NO_LIMITS: Final[Mapping[str, Fraction]] = MappingProxyType({})


def without_deadlines(spec: Spec) -> Spec:
    """Return the same spec with deadlines so long that only a datum whose delay has no bound misses its deadline."""
    variables = {name: replace(one, deadline_ns=_NO_DEADLINE_NS) for name, one in spec.variables.items()}
    return replace(spec, variables=variables)


def without_limits(spec: Spec) -> Spec:
    """Return the same spec with unlimited resources and time, and without placement rules: only its logic is left."""
    pes = {name: replace(pe, cpu_millis=PLENTY, ram=PLENTY, flash=PLENTY) for name, pe in spec.pes.items()}
    buses = {name: replace(bus, bitrate=PLENTY) for name, bus in spec.buses.items()}
    return replace(without_deadlines(spec), pes=pes, buses=buses, separate=(), together=())


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether all required functions can be served at the same time.

    configuration: a configuration that serves them; None: none was found. If the question was about elements that are
        down, it may be a configuration that was found for an earlier question and does not need these elements.
    proven: if `configuration` is None, whether it is proven that no configuration serves them.
    """

    configuration: Configuration | None
    proven: bool

    @property
    def impossible(self) -> bool:
        """Tell whether it is proven that no configuration serves all required functions."""
        return self.proven and self.configuration is None


def parts_of(spec: Spec, configuration: Configuration) -> dict[str, frozenset[str]]:
    """Return for each function that a legal configuration serves its part: the modules that the function needs of it.

    These are the module that serves it, and all that feeds this module, directly or not. Parts of a legal
    configuration, taken together, are a legal configuration: every input stays wired, and less is used of everything.
    """
    served = serving_modules(spec, configuration)
    return {function.name: _feeding(configuration, output) for function, output in served if output is not None}


def _feeding(configuration: Configuration, output: str) -> frozenset[str]:
    found, frontier = {output}, [output]
    while frontier:
        for wire in configuration.modules[frontier.pop()].inputs.values():
            if wire.producer not in found:
                found.add(wire.producer)
                frontier.append(wire.producer)
    return frozenset(found)


class _Known:
    """A legal configuration that was found before, in parts (`parts_of`)."""

    def __init__(self, spec: Spec, configuration: Configuration) -> None:
        self._configuration = configuration
        self._parts = parts_of(spec, configuration)
        self._values = {
            function.name: value_of(spec, configuration, function, output)
            for function, output in serving_modules(spec, configuration)
            if output is not None
        }
        self._used_by: dict[str, set[str]] = {}  # functions, by element
        for name, part in self._parts.items():
            for element in used_elements(spec, self._reduced(part)):
                self._used_by.setdefault(element, set()).add(name)

    def serving(self, functions: Collection[str], lost: frozenset[str], least: Mapping[str, int]) -> set[str]:
        """Return those of the functions that are served, with the value asked for, by parts that use nothing lost."""
        hit = set[str]().union(*(self._used_by.get(element, ()) for element in lost))
        served = self._values.keys() & set(functions) - hit
        return {name for name in served if self._values[name] >= least.get(name, 0)} if least else served

    def of(self, functions: Collection[str]) -> Configuration:
        """Return the parts of these functions as one configuration."""
        return self._reduced(frozenset[str]().union(*(self._parts[name] for name in functions)))

    def _reduced(self, modules: frozenset[str]) -> Configuration:
        return Configuration({name: one for name, one in self._configuration.modules.items() if name in modules})


class Planning:
    """Tells which functions of one spec can be served: in a phase, all at once, or with elements down.

    It keeps the plans and configurations that it has found, to answer later questions.
    """

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self._plans: dict[Phase, Plan] = {}
        self._of_phase: dict[Phase, Planning] = {}
        self._known: list[_Known] = []  # configurations found so far

    @cached_property
    def _intact(self) -> Survivors:
        return survivors(self.spec, Situation())

    def _lost(self, down: frozenset[str]) -> frozenset[str]:
        return lost_of(survivors(self.spec, Situation(down), self._intact)) if down else frozenset()

    @cached_property
    def _feeders(self) -> dict[str, set[str]]:
        return feeders(self.spec)

    @cached_property
    def times(self) -> ResponseTimes:
        """Return the response times on the buses of the spec."""
        return ResponseTimes(self.spec)

    def in_phase(self, phase: Phase) -> "Planning":
        """Return the `Planning` for a phase of the spec. It wires no input that `only_in` restricts to other phases.

        If the spec has no such input, this object itself is returned.
        """
        if phase not in self._of_phase:
            planned = self.spec.in_phase(phase)
            self._of_phase[phase] = self if planned is self.spec else Planning(planned)
        return self._of_phase[phase]

    def possible(self, functions: Set[str], down: frozenset[str] = frozenset()) -> frozenset[str]:
        """Return those of the functions that could be served without the elements in `down`.

        It is assumed that each module has its PE to itself.
        """
        lost = self._lost(down)
        known = max((one.serving(functions, lost, NOTHING_ASKED) for one in self._known), key=len, default=set[str]())
        left = [self.spec.functions[name] for name in functions if name not in known]
        if not left:
            return frozenset(known)
        used = contributors([output for function in left for output in function.outputs], self._feeders)
        part = {name: module for name, module in self.spec.modules.items() if name in used}
        asked = {function.name: replace(function, priority={None: 1}) for function in left}
        modules = candidates(replace(self.spec, modules=part, functions=asked), Situation(down)).modules
        return frozenset(known).union(one.name for one in left if any(output in modules for output in one.outputs))

    def can_serve(self, functions: Collection[str], down: frozenset[str]) -> bool:
        """Tell whether all these functions can be served at the same time while the elements in `down` are down."""
        lost = self._lost(down)
        if any(len(known.serving(functions, lost, NOTHING_ASKED)) == len(functions) for known in self._known):
            return True
        return self.all_at_once(functions, down).configuration is not None

    def all_at_once(
        self,
        functions: Collection[str],
        down: frozenset[str] = frozenset(),
        least: Mapping[str, int] = NOTHING_ASKED,
        limits: Mapping[str, Fraction] = NO_LIMITS,
    ) -> Answer:
        """Tell whether all these functions can be served at the same time while the elements in `down` are down.

        least: the lowest value with which each function may be served; 0 for a function that is not named.
        limits: the share of its capacity that an element has left; as in `Situation`.
        """
        known = self.survives(functions, down, least) if down and not limits else None
        if known is not None:
            return Answer(known, proven=True)
        search = Search(self.candidates_for(functions, down, least, limits), None, self.times, _EFFORT)
        # The first group of levels decides which functions are served, and in modes of which value. That is enough: the
        # question is only whether all functions can be served with the values in `least`.
        search.run(groups=1)
        if not self._serves(search.best, functions, least):
            return Answer(None, search.proven)
        self._known.append(_Known(self.spec, search.best))
        return Answer(search.best, search.proven)

    def survives(
        self, functions: Collection[str], down: frozenset[str], least: Mapping[str, int] = NOTHING_ASKED
    ) -> Configuration | None:
        """Return a known configuration that serves these functions and uses nothing that is lost when `down` is down.

        Only configurations that were found for earlier questions are tried, and parts of them (`_Known`); None if none
        of them does this.

        down: elements that are down.
        least: the lowest value with which each function may be served; 0 for a function that is not named.
        """
        lost = self._lost(down)
        whole = (known for known in self._known if len(known.serving(functions, lost, least)) == len(functions))
        return next((known.of(functions) for known in whole), None)

    def healthy(self, phase: Phase) -> Plan:
        """Return the best plan of a phase with everything up."""
        if phase not in self._plans:
            self._plans[phase] = plan(self.spec, Situation(phase=phase), effort=_EFFORT)
        return self._plans[phase]

    def unserved(self, functions: Collection[str], phase: Phase, down: frozenset[str] = frozenset()) -> frozenset[str]:
        """Return those of `functions` that the plan of a phase does not serve.

        Without `down`, this is the best plan with everything up; with `down`, the contingency plan for `down`.
        """
        found = self.contingency(phase, down) if down else self.healthy(phase)
        return frozenset(name for name in functions if not found.functions[name].served)

    def contingency(self, phase: Phase, down: frozenset[str]) -> Plan:
        """Return the best plan of a phase while the elements in `down` are down.

        It is assumed that the best plan with everything up ran before the loss of these elements.
        """
        running = placement(self.healthy(phase).configuration)
        return plan(self.spec, Situation(down, phase=phase), running, effort=_EFFORT)

    def _serves(self, configuration: Configuration, functions: Collection[str], least: Mapping[str, int]) -> bool:
        return all(
            output is not None and value_of(self.spec, configuration, function, output) >= least.get(function.name, 0)
            for function, output in serving_modules(self.spec, configuration)
            if function.name in functions
        )

    def candidates_for(
        self,
        functions: Collection[str],
        down: frozenset[str] = frozenset(),
        least: Mapping[str, int] = NOTHING_ASKED,
        limits: Mapping[str, Fraction] = NO_LIMITS,
    ) -> Candidates:
        """Return all choices of the planner (`Candidates`) if only these functions are wanted, all with one priority.

        least: by name of a function, the lowest value with which the function may be served; 0 for a function that is
            not named. In the candidates, a mode has the value 1 if this lowest value is above 0 and the mode reaches
            it. All other modes have the value 0.
        """
        wanted = {
            name: replace(
                function, criticality={None: "A"}, priority={None: 1}, value=self._enough(function, least.get(name, 0))
            )
            for name, function in self.spec.functions.items()
            if name in functions
        }
        return candidates(replace(self.spec, functions=wanted), Situation(down, limits))

    def _enough(self, function: Function, least: int) -> tuple[int, ...]:
        counts = [len(self.spec.modules[output].modes) for output in function.outputs]
        return tuple(
            int(least > 0 and any(function.value_of(index, count) >= least for count in counts if index < count))
            for index in range(max(counts))
        )
