"""Flies a script in the simulator: virtual time, the cores of an aircraft, random values from the script's seed.

A flight must meet the expectations of its script. Besides, the oracles of the simulator verify it in the same way as a
drawn flight (`end_of_flight`):

- The rules that must always hold were never violated, and each critical function was served whenever it could be.
- The aircraft converges. For this, every fault that can be ended is ended after the script.

An exception of a core ends the flight, which then fails.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout

from heronry_manager.events import Reconfigured
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.fault import MANAGERS
from heronry_tools.sim.flight.end_of_flight import end_flight, ended_by, not_injected
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import KEY, bring_tables, lossy, need_key
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Injected
from heronry_tools.sim.scenario.evaluation import Evaluation
from heronry_tools.sim.scenario.flown import Flown
from heronry_tools.sim.scenario.observations import Observations
from heronry_tools.sim.scenario.script import ORDERS, Deed, Script
from heronry_tools.sim.scenario.trace import deed_line, differences, event_line
from heronry_tools.sim.world.next_spec import next_spec
from heronry_tools.sim.world.planning import Planners
from heronry_wire.identifiers import FIRST_MANAGER

_LONGEST_START_NS = 20_000 * MS


def _take_off(script: Script) -> Simulation:
    """Return the simulation of a script; the PEs that are absent at first do not run yet."""
    return Simulation(
        script.spec,
        script.seed,
        faults=lossy(script.loss),
        contingencies=script.contingencies,
        standby=script.has_standby,
        key=KEY if script.has_key or need_key(script.faults) else None,
        planners=Planners.IMMEDIATE if script.is_unforeseen else Planners.BEST,
        absent=[element.removeprefix("pe:") for element in script.without],
        brings_tables=bring_tables(script.faults),
        following=None if script.reload is None else next_spec(script.reload),
    )


def fly(script: Script, *, is_compared: bool = True, watch: Callable[[Simulation], None] | None = None) -> Flown:
    """Fly a script and return the result; raises UserError if the aircraft does not start, or refuses an order.

    is_compared: whether to compare the trace with the golden one, if there is one
    watch: is called with the simulation before the flight begins
    """
    flight = _take_off(script)
    if watch is not None:
        watch(flight)
    heard = Observations(script.spec)
    flight.wiring.tap(script.spec.manager.bus, lambda sent: heard.see(sent.end_ns, sent.frame))
    lines: tuple[str, ...] = ()  # stays empty if an exception of a core ends the flight
    try:
        with redirect_stdout(sys.stderr):  # what modules print is no result
            injections, deeds = _play(flight, script)
            lines = _decided(flight, deeds)
            violations = _end(flight, script, injections)
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - an exception of a core, of any type, is a finding
        violations = [str(violation) for violation in ended_by(flight, error)]
    evaluation = Evaluation(script.spec, heard, _start_ns(flight))
    return Flown(
        script,
        "the simulator",
        script.end_ns / 1e9,
        tuple(evaluation.verdict(one) for one in script.expectations),
        tuple(violations),
        lines,
        differences(script.file, lines) if lines and is_compared else None,
        flight.digest(),
    )


def _play(flight: Simulation, script: Script) -> tuple[Injections, list[tuple[int, str]]]:
    """Do what the script says, to its end.

    Returns the injections, and two values for each deed of the script: how many events the flight had before
    the deed, and the line of the trace for the deed.
    """
    for module in script.reported_modules():
        flight.truth.excuse(module)
    _begin(flight, script)
    start_ns = _start_ns(flight)
    injections, deeds = Injections(flight, script.faults, start_ns), []
    for deed in script.deeds:
        flight.run_until(start_ns + deed.at_ns)
        deeds.append((len(flight.events), deed_line(deed.at_ns / 1e9, deed.text)))
        _do(flight, script, deed)
    flight.run_until(start_ns + script.end_ns)
    return injections, deeds


def _end(flight: Simulation, script: Script, injections: Injections) -> list[str]:
    """End the flight; return its violations as sentences."""
    injections.injected += _injected(flight, script)
    violations = end_flight(flight, injections, (deed.target for deed in script.deeds))
    return [*_missed(script, injections), *map(str, flight.waivers.promised(violations))]


def _injected(flight: Simulation, script: Script) -> Iterator[Injected]:
    """Return the kills and the jammed actuators of a script as faults, for the oracle `service`.

    If one of two managers is killed, the kill is a fault without duration, since the other manager takes over. The
    fault of a jammed actuator names no element, since it depends on the monitors when the actuator counts as failed.
    """
    start_ns, restored = _start_ns(flight), dict[str, int]()
    for deed in reversed(script.deeds):
        at_ns, is_manager = start_ns + deed.at_ns, deed.target in MANAGERS
        if deed.what == "restore":
            restored[deed.target] = at_ns
        elif deed.what == "kill":
            for_good = at_ns if is_manager and flight.managers.running else None
            yield Injected(None if is_manager else deed.target, at_ns, restored.pop(deed.target, for_good))
        elif deed.what == "stick":
            yield Injected(None, at_ns, None)


def _missed(script: Script, injections: Injections) -> Iterator[str]:
    """Return a sentence for each fault that was not injected, or not in the state that the script names."""
    for deed in script.deeds:
        story = None if deed.fault is None else not_injected(deed.fault, deed.text, injections)
        if story is not None:
            yield f"{script.file}:{deed.line}: {story}"


def _begin(flight: Simulation, script: Script) -> None:
    """Simulate until the first configuration runs; raises UserError if that takes too long."""
    while not flight.events_of(Reconfigured):
        flight.run_for(MS)
        if flight.now_ns > _LONGEST_START_NS:
            raise UserError(
                f"{script.file}: the aircraft does not start: no configuration runs within "
                f"{_LONGEST_START_NS // 10**9} s; 'heronry plan SPEC' shows what its spec can run"
            )


def _start_ns(flight: Simulation) -> int:
    """Return the time (ns) at which the first configuration began to run; the present time if none has run."""
    return next((event.t_ns for event in flight.events_of(Reconfigured)), flight.now_ns)


def _do(flight: Simulation, script: Script, deed: Deed) -> None:
    try:
        match deed.what, deed.target:
            case "fault" | "wait", _:
                pass  # `Injections` injects faults
            case "stick", device:
                flight.fail_device(device.removeprefix("device:"), "stuck")
            case "kill", target if target in MANAGERS:
                flight.managers.kill(MANAGERS[target])
            case "restore", target if target in MANAGERS:
                flight.managers.start(MANAGERS[target] or FIRST_MANAGER)
            case "kill", pe:
                flight.fleet.kill(pe.removeprefix("pe:"))
            case "restore", pe:
                flight.fleet.arrive(pe.removeprefix("pe:"))
            case _:
                _say(flight, deed)
    except UserError as error:
        raise UserError(f"{script.file}:{deed.line}: {error}") from None


def _say(flight: Simulation, deed: Deed) -> None:
    """Give the active manager the operator's order that a deed names."""
    if deed.what == "reload":
        assert flight.reloads is not None
        reply = flight.reloads.order_once()
    else:
        reply = flight.operator.say(ORDERS[deed.what](deed.target))
    if reply is None:
        raise UserError(f"'{deed.text}': no manager is active at that time to accept the order; choose another time")
    if not reply.done:
        raise UserError(f"'{deed.text}': {reply.sentence}")


def _decided(flight: Simulation, deeds: list[tuple[int, str]]) -> tuple[str, ...]:
    """Return the lines of the trace: what was done and what the manager decided, in order of time."""
    lines, waiting = [], list(deeds)
    for number, event in enumerate(flight.events):
        while waiting and waiting[0][0] <= number:
            lines.append(waiting.pop(0)[1])
        line = event_line(event)
        if line is not None:
            lines.append(line)
    return (*lines, *(line for _, line in waiting))
