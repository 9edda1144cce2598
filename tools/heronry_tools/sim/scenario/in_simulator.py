"""A script flown in the simulator: virtual time, the flight cores, everything from the script's seed.

Beside what the script expects, the simulator's oracles verify all that they know, as in a flight that a seed draws
(`end_of_flight`): what must never be, silence for which there is no need, and, once all faults that can be ended have
been ended after the script's end, that all comes right again. A core that dies ends the flight, and fails it.
"""

from collections.abc import Iterator

from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.fault import MANAGERS
from heronry_tools.sim.flight.end_of_flight import end_flight, ended_by, not_injected
from heronry_tools.sim.flight.injections import Injections
from heronry_tools.sim.flight.outcome import KEY, lossy, need_key
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Injected
from heronry_tools.sim.scenario.evaluation import Evaluation
from heronry_tools.sim.scenario.flown import Flown
from heronry_tools.sim.scenario.observations import Observations
from heronry_tools.sim.scenario.script import ORDERS, Deed, Script
from heronry_tools.sim.scenario.trace import deed_line, differences, event_line
from heronry_tools.sim.world.planning import Planners
from heronry_wire.identifiers import FIRST_MANAGER

_LONGEST_START_NS = 20_000 * MS


def _take_off(script: Script) -> Simulation:
    """Begin the flight of a script, without the PEs that are not there yet."""
    return Simulation(
        script.spec,
        script.seed,
        faults=lossy(script.loss),
        contingencies=script.contingencies,
        standby=script.has_standby,
        key=KEY if script.has_key or need_key(script.faults) else None,
        planners=Planners.IMMEDIATE if script.is_unforeseen else Planners.BEST,
        absent=[element.removeprefix("pe:") for element in script.without],
    )


def fly(script: Script, *, is_compared: bool = True) -> Flown:
    """Fly a script; raises UserError where something cannot be done at its time.

    is_compared: with its golden trace, if there is one; not where that is to be made anew.
    """
    flight = _take_off(script)
    heard = Observations(script.spec)
    flight.wiring.tap(script.spec.manager.bus, lambda sent: heard.see(sent.end_ns, sent.frame))
    lines: tuple[str, ...] = ()  # of a flight that a core has ended there are none
    try:
        injections, deeds = _play(flight, script)
        lines = _decided(flight, deeds)
        violations = _end(flight, script, injections)
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - any death of a core is what is looked for
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
    """Do what the script says, up to its end; gives its deeds: how many events were before, and the trace line."""
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
    """End the flight; gives what must not be, as sentences."""
    injections.injected += _injected(flight, script)
    violations = end_flight(flight, injections, (deed.target for deed in script.deeds))
    return [*_missed(script, injections), *map(str, flight.waivers.promised(violations))]


def _injected(flight: Simulation, script: Script) -> Iterator[Injected]:
    """Give what was done besides faults, as far as its effects can be verified.

    Of two managers the death of one is an instant, since the other one takes over. When an actuator that sticks is
    noticed depends on the monitors.
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
    """Sentences on faults that were not injected, or not in the state that the script names."""
    for deed in script.deeds:
        story = None if deed.fault is None else not_injected(deed.fault, deed.text, injections)
        if story is not None:
            yield f"{script.file}:{deed.line}: {story}"


def _begin(flight: Simulation, script: Script) -> None:
    """Fly to the moment at which the first configuration runs."""
    while not flight.events_of("reconfigured"):
        flight.run_for(MS)
        if flight.now_ns > _LONGEST_START_NS:
            raise UserError(f"{script.file}: no configuration has run within {_LONGEST_START_NS // 10**9} s")


def _start_ns(flight: Simulation) -> int:
    """When the first configuration ran; now, where none has."""
    return next((event["t_ns"] for event in flight.events_of("reconfigured")), flight.now_ns)


def _do(flight: Simulation, script: Script, deed: Deed) -> None:
    try:
        match deed.what, deed.target:
            case "fault", _:
                pass  # it is injected by `Injections`
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
    """Let the operator give an order."""
    reply = flight.operator.say(ORDERS[deed.what](deed.target))
    if reply is None:
        raise UserError(f"'{deed.text}': no manager is active then that could accept it; do it at another time")
    if not reply.done:
        raise UserError(f"'{deed.text}': {reply.sentence}")


def _decided(flight: Simulation, deeds: list[tuple[int, str]]) -> tuple[str, ...]:
    """Lines of the trace: what was done, and what the manager decided, in the order of time."""
    lines, waiting = [], list(deeds)
    for number, event in enumerate(flight.events):
        while waiting and waiting[0][0] <= number:
            lines.append(waiting.pop(0)[1])
        line = event_line(event)
        if line is not None:
            lines.append(line)
    return (*lines, *(line for _, line in waiting))
