"""The check of DG3xx: room, bandwidth and time for all that is wanted, with everything up.

Checks without a solver come first: each module against the PEs, and each bus's reserve against its management
frames. Then the planner is used (servable.py). The forced traffic is worked out only for functions that the
planner cannot serve.

Each cause is reported only once:

- If the modules of a function fit nowhere, or the data of this function alone overload a bus, the function is
  not checked again.
- If deadlines are the only reason why a function is not served, the data that would be late are reported.
- What no plan serves for another cause is reported with the reason of the plan (unserved.py), unless a module of it
  fits nowhere or lacks its data; the rules of the graph, and DG301, report this.

Two kinds of specs are not planned: a spec with more sources than identifiers (DG505), since the priorities of its
frames are unknown, and a spec with a bus that management fills (DG307), since no datum would ever arrive there.
"""

from collections.abc import Collection, Iterable, Mapping
from math import ceil
from typing import Final

from heronry_dg.check.actuators import driver_conflicts
from heronry_dg.check.subject import Subject
from heronry_dg.check.wire import lacks_identifiers
from heronry_dg.configuration import Configuration
from heronry_dg.echo_rates import EchoRates, ReserveUse
from heronry_dg.findings import Findings, listed
from heronry_dg.model import Bus, Mode, Module, Pe, Spec
from heronry_dg.response_times import Late, ResponseTimes
from heronry_dg.rules.graph import NEVER_HOLDS
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors
from heronry_dg.traffic import Hop, hops
from heronry_tools.analysis import servable
from heronry_tools.analysis.check import resource_rules as rules
from heronry_tools.analysis.check import unserved
from heronry_tools.analysis.check.forced_traffic import forced_traffic
from heronry_tools.analysis.check.homes import fits
from heronry_tools.analysis.check.reach import check_reach
from heronry_tools.analysis.check.wanted import Phase, critical_functions, in_phases, phases, wanted_functions
from heronry_tools.analysis.servable import Planning

_SHOWN: Final = 4


def check(subject: Subject, findings: Findings) -> None:
    """Check a spec against every rule of resource_rules.py, and add a finding for each mistake."""
    for module in subject.spec.modules.values():
        _fits(subject, findings, module)
    buses = subject.spec.buses.values()
    uses = EchoRates(subject.spec).by_bus
    for bus in buses:
        _reserve(subject, findings, bus, uses[bus.name])
    check_reach(subject, findings)
    swamped = [bus for bus in buses if bus.kind == "wired" and uses[bus.name].rest >= bus.bitrate]  # no datum arrives
    if not swamped and not lacks_identifiers(subject.spec):
        _Serving(subject, findings).check()


def _fits(subject: Subject, findings: Findings, module: Module) -> None:
    """Report a module of which all modes are too large for every PE on which it may run.

    If only some modes are too large for every such PE, report these modes.
    """
    spec = subject.spec
    hosts = hosts_when_all_is_up(spec, module)
    large = [mode for mode in module.modes.values() if not any(fits(spec, module, mode, pe) for pe in hosts)]
    if len(large) == len(module.modes):
        sentence = f"module '{module.name}' fits no PE: {_why_no_pe(spec, module, hosts)}"
        hint = "allow or enlarge a PE, or let the module need less"
        findings.add(rules.MODULE_FITS_NOWHERE, subject.place("modules", module.name), sentence, hint)
        return
    for mode in large:
        sentence = f"mode '{mode.name}' of module '{module.name}' fits no PE: {_too_large(spec, module, mode, hosts)}"
        place = subject.place("modules", module.name, "modes", mode.name)
        findings.add(
            rules.MODE_FITS_NOWHERE, place, sentence, "let the mode need less, enlarge a PE, or remove the mode"
        )


def _why_no_pe(spec: Spec, module: Module, hosts: Collection[str]) -> str:
    if not hosts:
        required = [f"feature {name}" for name in sorted(module.requires)]
        required += [f"device {module.device}"] if module.device is not None else []
        required += [f"runs_on {listed(module.runs_on, last='or')}"] if module.runs_on is not None else []
        return f"none has what it requires, {listed(required)}" if required else "the spec has no PE"
    least = min(module.modes.values(), key=lambda mode: (mode.cpu_millis, mode.ram))
    return _too_large(spec, module, least, hosts)


def _too_large(spec: Spec, module: Module, mode: Mode, hosts: Collection[str]) -> str:
    return ", ".join(f"{pe} has {_lacking(spec.pes[pe], module, mode)}" for pe in list(hosts)[:_SHOWN])


def _lacking(pe: Pe, module: Module, mode: Mode) -> str:
    resources = [("bytes of ram", pe.ram, mode.ram), ("bytes of flash", pe.flash, module.flash)]
    short = [f"{has} of {needs} {what}" for what, has, needs in resources if needs > has]
    if mode.cpu_millis > pe.cpu_millis:
        short.insert(0, f"{pe.cpu_millis / 1000:g} of {mode.cpu_millis / 1000:g} cpu")
    return listed(short)


def _reserve(subject: Subject, findings: Findings, bus: Bus, use: ReserveUse) -> None:
    """Report a bus if its reserve is smaller than the load of the management frames that it always carries."""
    reserved = bus.bitrate * bus.reserve
    if use.total <= reserved:
        return
    reports = ", reports on radios" if use.reports else ""
    sentence = (
        f"bus '{bus.name}' reserves {float(reserved):.0f} bit/s, but states, LEASE and ALIVE, CANopen heartbeats"
        f"{reports} and the echoes of {use.outputs} outputs take {float(use.total):.0f} bit/s"
    )
    remedies, others = [], use.total - use.periodic
    if use.total < bus.bitrate * bus.max_load:
        remedies.append(f"reserve: {ceil(use.total * 1000 / bus.bitrate) / 1000:g}")
    if others < reserved:
        remedies.append(f"heartbeat_ms: {ceil(bus.heartbeat_ns * use.periodic / (reserved - others) / 1_000_000)}")
    hint = f"write {listed(remedies, last='or')}, or more" if remedies else "raise the bit rate"
    rule = rules.RADIO_RESERVE_TOO_SMALL if bus.kind == "wireless" else rules.RESERVE_TOO_SMALL
    findings.add(rule, subject.place("buses", bus.name, "reserve"), sentence, hint)


class _Serving:
    """Finds the functions that cannot be served with everything up, and reports the reason for each."""

    def __init__(self, subject: Subject, findings: Findings) -> None:
        self._subject, self._findings, self._spec = subject, findings, subject.spec
        self._phases = phases(self._spec)
        self._planning = servable.Planning(self._spec)
        self._undue = servable.Planning(servable.without_deadlines(self._spec))
        self._unlimited = servable.Planning(servable.without_limits(self._spec))
        named = {phase: wanted_functions(self._spec, phase) for phase in self._phases}
        reached = servable.Planning(unserved.with_reach(self._spec)).possible(_union(named.values()))
        self._wanted = {phase: names & reached for phase, names in named.items()}  # others are reported otherwise
        self._told: dict[Phase, set[str]] = {phase: set() for phase in self._phases}
        for conflict in driver_conflicts(self._spec):  # reported as DG248, and for a critical function once more here
            for phase in conflict.phases:
                self._told[phase].update(set(conflict.functions) - critical_functions(self._spec, phase))

    def check(self) -> None:
        """Report the functions that cannot be served with everything up.

        As a rule it is certain at once that each best plan serves everything. If it is not, all causes are searched
        that have rules of their own: first of each function alone, and then of the critical functions of each phase
        together. What is left, and what no way to a PE allows, gets its reason from the plans.
        """
        if unserved.serves_everything(self._planning, self._wanted):
            return
        possible = {phase: self._at(phase).possible(names) for phase, names in self._wanted.items()}
        critical = {phase: critical_functions(self._spec, phase) & names for phase, names in possible.items()}
        fitting = {phase: names for phase, names in critical.items() if self._fit(phase, names)}
        for name in self._spec.functions:
            at = [phase for phase in self._phases if name in possible[phase] - fitting.get(phase, frozenset())]
            if at and self._never_fits(name, at):
                self._tell([name], at)
        self._each_phase({phase: names for phase, names in critical.items() if phase not in fitting})
        unserved.check_unserved(self._subject, self._findings, self._planning, self._wanted, self._told)

    def _at(self, phase: Phase) -> Planning:
        return self._planning.in_phase(phase)

    def _fit(self, phase: Phase, names: frozenset[str]) -> bool:
        return self._at(phase).all_at_once(names).configuration is not None

    def _tell(self, names: Iterable[str], at: Iterable[Phase]) -> None:
        """Note that findings are about functions in some phases."""
        for phase in at:
            self._told[phase].update(names)

    def _never_fits(self, name: str, at: list[Phase]) -> bool:
        """Tell whether a function cannot be served in some phases even if no other function is wanted.

        If so, add a finding with the cause: deadlines, overloaded buses or too little room. If the function could
        not be served with unlimited resources either, nothing is added: DG232 may tell why, or else the reason of the
        plan follows.
        """
        if not self._at(at[0]).all_at_once([name]).impossible:
            return False
        late = self._undue.in_phase(at[0]).all_at_once([name]).configuration
        if late is not None:
            self._tell_late(late, f"'{name}'")
        elif not self._overloads([name], at):
            if self._unlimited.in_phase(at[0]).all_at_once([name]).impossible:
                return any(finding.code == NEVER_HOLDS.code for finding in self._findings)
            sentence = f"function '{name}' cannot be served with everything up, even if nothing else were wanted"
            short = unserved.short_of(self._planning, at[0], name)
            hint = "its modules fit alone, but not together: check the PEs, buses and placement rules that they need"
            self._findings.add(rules.NEVER_FITS, self._subject.place("functions", name), sentence + short, hint)
        return True

    def _each_phase(self, critical: Mapping[Phase, frozenset[str]]) -> None:
        """Report, for each phase, the critical functions that the best plan of the phase gives up.

        critical: the critical functions that do not all fit. Those that were found to be impossible even alone are
            left out.
        """
        crowded: dict[str, list[Phase]] = {}
        for phase, names in critical.items():
            wanted = names - self._told[phase]
            if self._fit(phase, wanted):
                continue
            if self._overloads(wanted, [phase]):
                self._tell(wanted, [phase])
                continue
            lost = self._planning.unserved(wanted, phase)
            late = lost - self._undue.unserved(wanted, phase)
            if late:
                self._tell_late(self._undue.healthy(phase).configuration, listed(f"'{name}'" for name in sorted(late)))
            self._tell(lost, [phase])
            for name in lost - late:
                crowded.setdefault(name, []).append(phase)
        for name, at in crowded.items():
            self._tell_crowded(name, at)

    def _tell_crowded(self, name: str, at: list[Phase]) -> None:
        function, when = self._spec.functions[name], in_phases(self._spec, at)
        classes = "/".join(dict.fromkeys(function.criticality_in(phase) for phase in at))
        sentence = (
            f"function '{name}' (class {classes}) finds no room beside the other critical ones{when}, "
            "with everything up"
        ) + unserved.short_of(self._planning, at[0], name)
        hint = "give the PEs more room, or let modules need less; `heronry plan` shows which modules take the room"
        self._findings.add(rules.CRITICAL_DO_NOT_FIT, self._subject.place("functions", name), sentence, hint)

    def _overloads(self, functions: Collection[str], at: list[Phase]) -> bool:
        """Report the buses that cannot carry the data which these functions need; True if there is such a bus."""
        possible = self._at(at[0]).candidates_for(functions)
        forced = forced_traffic(possible)
        overloaded = list(forced.overloaded(possible.left.bus_mbit_per_s))
        for bus in overloaded:
            loads = forced.mbit_per_s(bus)
            heaviest = sorted(loads, key=lambda name: -loads[name])[:_SHOWN]
            served = listed(f"'{name}'" for name in sorted(functions)) + in_phases(self._spec, at)
            sentence = (
                f"bus '{bus}' must carry {sum(loads.values()) // 1000} bit/s for {served}, "
                f"but data may take only {possible.left.bus_mbit_per_s[bus] // 1000}"
            )
            hint = "most of it is " + listed(f"{name} with {loads[name] // 1000} bit/s" for name in heaviest)
            self._findings.add(rules.BUS_OVERLOADED, self._subject.place("buses", bus), sentence, hint)
        return bool(overloaded)

    def _tell_late(self, configuration: Configuration, served: str) -> None:
        """Report each datum that would be late if `configuration` ran with everything up.

        served: the functions that cannot be served because of these late data, as a part of a sentence.
        """
        published = hops(survivors(self._spec, Situation()), configuration)
        times = self._planning.times
        for late in times.late(published):
            hop, name = late.hop, late.hop.variable
            sentence = (
                f"'{name}' from '{hop.producer}' takes up to {_ms(late.response_ns)} on bus '{hop.bus}' and must "
                f"arrive within {_ms(late.deadline_ns)}; if it arrives later, {served} cannot be served"
            )
            place = self._subject.place("variables", name, "deadline_ms")
            self._findings.add(rules.LATE, place, sentence, self._before(times, late, published))

    def _before(self, times: ResponseTimes, late: Late, published: Iterable[Hop]) -> str:
        """Write which frames go before a late datum on its bus: period, response time and deadline of each.

        Only the first `_SHOWN` frames are named; of further ones the number is given.
        """
        there = [one for one in times.responses(published) if one.hop.bus == late.hop.bus]
        ahead = there[: [one.hop for one in there].index(late.hop)]
        shown = [
            f"'{one.hop.variable}' every {_period_ms(self._spec, one.hop):g} ms "
            f"({_ms(one.response_ns)} of {_ms(one.deadline_ns)})"
            for one in ahead[:_SHOWN]
        ]
        more = [f"{len(ahead) - _SHOWN} more"] if len(ahead) > _SHOWN else []
        bus = self._spec.buses[late.hop.bus]
        others = "".join(f", {one}" for one in shown + more)
        return f"frames that go first: management every {bus.heartbeat_ns / 1e6:g} ms{others}"


def _union(sets: Iterable[frozenset[str]]) -> frozenset[str]:
    return frozenset[str]().union(*sets)


def _ms(time_ns: int | None) -> str:
    return "any time" if time_ns is None else f"{time_ns / 1e6:.3f} ms"


def _period_ms(spec: Spec, hop: Hop) -> float:
    return 1e6 / spec.modules[hop.producer].modes[hop.mode].rate_mhz
