"""Another spec, by which the aircraft is to fly without a landing (`core/reloading`): what no core can know.

The core of a manager knows one spec. Here the next one is read, compared with it, planned from what runs, and compiled;
and the memory of the core of the present spec becomes that of the next one. Everything is known by its name: what the
next spec does not have is forgotten, a number is kept.

Everything here is computed from its arguments; `SpecReloads` (`spec_reloads`) has the thread and the files.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.situation import Situation, UnknownElementError, checked_element
from heronry_dg.traffic import identifiers
from heronry_dg.verify import verify
from heronry_dg.wire_limits import require_wire_limits
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.core.memory import Memory, Runs
from heronry_manager.core.tables import Compiler, PeTables
from heronry_manager.core.vocabulary import ReloadSpec, RequestSwitch, SpecSwitched, SwitchReady
from heronry_manager.planner.greedy.planner import Greedy
from heronry_wire.element_places import spec_mark


class OtherSpec:
    """A spec that is to take the place of the present one."""

    def __init__(self, spec: Spec) -> None:
        """Compile the tables of the spec; raises WireLimitError if it exceeds a limit of the wire."""
        require_wire_limits(spec)
        self.spec, self.compiler = spec, Compiler(spec)
        self.contents = PeTables(self.compiler, ()).contents()
        self._row = ""  # of the configuration that was compiled last

    @cached_property
    def planner(self) -> Greedy:
        """The planner that answers at once."""
        return Greedy(self.spec)

    def warm_up(self) -> None:
        """Compute what takes long at the first plan."""
        compiled = self.compiler.configuration(self.planner.plan(Situation()).configuration)
        assert compiled.digest

    def order(self, present: Spec) -> ReloadSpec | str:
        """Return the order for the core of the present spec, or why the aircraft cannot change in flight."""
        reason = next(self._reasons(present), None)
        if reason is not None:
            return reason
        old, new = identifiers(present), identifiers(self.spec)
        held = {identifier: source for source, identifier in old.items()}
        passes = any(held.get(identifier, source) != source for source, identifier in new.items())
        return ReloadSpec(
            self.spec.name,
            self.spec.digest,
            {pe: content for pe, content in self.contents.items() if pe in present.pes},
            frozenset(present.pes.keys() - self.spec.pes.keys()),
            passes,
        )

    def first(self, request: RequestSwitch) -> SwitchReady:
        """Plan from what runs, and compile; the time is that of the immediate planner and the verifier."""
        now = self._now(request.now)
        plan = self.planner.plan(now, self._running(request.running))
        broken = verify(self.spec, now, plan.configuration)
        if broken:
            return SwitchReady(
                request.number, problem=f"the planner finds no legal plan of the other spec: {broken[0]}"
            )
        compiled = self.compiler.configuration(plan.configuration)
        self._row = ConfigurationCode(self.spec).encode(plan.configuration).hex()
        return SwitchReady(request.number, plan, compiled.digest, compiled.slices, compiled.slice_digests)

    def memory(self, before: Memory, switched: SpecSwitched | None) -> Memory:
        """Return the memory with which a core of this spec begins.

        before: that of the core before it. switched: what runs; None: a standby manager has yet to overhear it.
        """
        phases, functions, pes = self.spec.phases, self.spec.functions, self.spec.pes
        return replace(
            before,
            runs=None if switched is None else Runs(switched.epoch, switched.digest, self._row),
            flies=spec_mark(self.spec.digest),
            phase=before.phase if before.phase in phases else None,
            latched={element: one for element, one in before.latched.items() if self._has(element)},
            quarantined={pe: losses for pe, losses in before.quarantined.items() if pe in pes},
            phase_requests={pe: one for pe, one in before.phase_requests.items() if pe in pes},
            priorities={name: one for name, one in before.priorities.items() if name in functions},
            priority_requests={
                key: one for key, one in before.priority_requests.items() if key[0] in pes and key[1] in functions
            },
        )

    def _reasons(self, present: Spec) -> Iterator[str]:
        """Yield the reasons for which nodes would have to be restarted."""
        spec, before = self.spec, Compiler(present)
        if spec.digest == present.digest:
            yield f"the aircraft flies by this spec already ({spec.name})"
        here, there = present.buses[present.manager.bus], spec.buses.get(spec.manager.bus)
        if there is None or replace(there, rate_per_h=None, probability=None) != replace(
            here, rate_per_h=None, probability=None
        ):
            yield f"bus {here.name}, which carries the manager, is another one: that needs a landing"
        nodes = {pe.node_id: pe.name for pe in present.pes.values()}
        for pe in spec.pes.values():
            if nodes.get(pe.node_id, pe.name) != pe.name:
                yield f"node {pe.node_id} is pe:{nodes[pe.node_id]}, and pe:{pe.name} in the other spec"
            if pe.name not in present.pes:
                continue
            old, new = before.table(pe.name), self.compiler.table(pe.name)
            told = [(replace(port, nodes=()), port.bus) for port in old.ports]
            if old.node_id != new.node_id or told != [(replace(port, nodes=()), port.bus) for port in new.ports]:
                yield f"the node-ID or the buses of pe:{pe.name} are others: that needs a restart of this PE"

    def _now(self, now: Situation) -> Situation:
        spec = self.spec
        return Situation(
            frozenset(element for element in now.down if self._has(element)),
            {element: share for element, share in now.limits.items() if self._has(element)},
            now.phase if now.phase in spec.phases else next(iter(spec.phases), None),
            {function: priority for function, priority in now.priorities.items() if function in spec.functions},
        )

    def _running(self, running: Placement) -> Placement:
        """Return what runs, without what this spec does not have."""
        modules = self.spec.modules
        return {
            name: (mode, pe)
            for name, (mode, pe) in running.items()
            if name in modules and mode in modules[name].modes and pe in self.spec.pes
        }

    def _has(self, element: str) -> bool:
        try:
            checked_element(self.spec, element)
        except UnknownElementError:
            return False
        return True
