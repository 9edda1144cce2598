"""`heronry fly`: an aircraft in a flight dynamics model, flown by its avionics on simulated PEs and buses.

Exit codes: 0 flown (whatever the landing was like); 1 an oracle was violated (--judged); 2 the input cannot be used.
"""

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.command_lines.fly import NEVER
from heronry_tools.console.errors import UserError
from heronry_tools.console.output import expect_ending
from heronry_tools.console.progress import Working, show_line
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.console.whole_file import expect_writable, write_whole
from heronry_tools.fly import glider_mission, mission
from heronry_tools.fly.acceptance import interval
from heronry_tools.fly.campaign import Drawn, latency_line, quantiles
from heronry_tools.fly.glider_campaign import missions
from heronry_tools.fly.glider_mission import GliderMission
from heronry_tools.fly.kinds import KINDS, Kind, aircraft_of
from heronry_tools.fly.live.flight import fly_live
from heronry_tools.fly.mission import Blow, Mission
from heronry_tools.fly.report import dispersion_page, flight_page
from heronry_tools.fly.report.dispersion_page import Landing as Dispersed
from heronry_tools.sim.compiled.machine_code import go_on_compiled
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.flight.campaign import fly_all
from heronry_wire.spelling import kind_word, meant

_MOST = 100_000  # largest number of an option, in s or in m of height: more than any flight needs
_HOW = ("dead", "stuck", "bias", "loose")


def run(arguments: argparse.Namespace) -> int:
    """Fly every seed; returns the exit code."""
    for file, ending in ((arguments.record, ".json"), (arguments.report, ".html")):
        if file is not None:  # checked now, so that a wrong name is reported before the flight
            expect_ending(file, {ending[1:]: (ending,)})
            expect_writable(file)
    if arguments.live:
        return _run_live(arguments)
    if arguments.compiled:
        go_on_compiled(arguments.argv)

    spec = load_spec_file(arguments.spec)
    name = aircraft_of(spec)
    kind = KINDS[name]
    missions = _missions(spec, name, arguments)
    if arguments.record is not None and arguments.runs > 1:
        raise UserError("--record writes the record of one flight; leave --runs out")
    landings: list[Any] = []
    flown = _flown(spec, kind, missions, arguments)
    if len(missions) == 1:  # its seconds are not known: it ends on the ground
        with Working(f"flying {spec.name}"):
            flown = iter(list(flown))
    _tell(arguments, len(landings))
    for landing in flown:
        _tell(arguments, None)
        landings.append(landing)
        print(json.dumps(landing.document()) if arguments.json else kind.line(landing), flush=True)
        _tell(arguments, len(landings))
    _tell(arguments, None)
    if arguments.json or len(landings) > 1 or arguments.latency:
        found = kind.summary(landings)
        print(json.dumps(found) if arguments.json else kind.figures(found))
    if arguments.report is not None and len(landings) > 1:
        _write_dispersion(arguments.report, f"{spec.name}: {len(landings)} flights", map(kind.dispersed, landings))
    return 1 if any(landing.violations for landing in landings) else 0


def _tell(arguments: argparse.Namespace, done: int | None) -> None:
    """Show on a terminal how many of many flights are flown; None: show nothing."""
    if arguments.runs > 1:
        show_line("" if done is None else f"{done} of {arguments.runs} flights")


def _run_live(arguments: argparse.Namespace) -> int:
    """Fly the seeds in real time, one after the other; returns the exit code."""
    unfit = ("compiled", "judged", "must_land", "phase", "report")
    for name in unfit:
        if getattr(arguments, name):
            raise UserError(f"--{name.replace('_', '-')} is for flights in virtual time; leave --live out")
    if arguments.record is not None and arguments.runs > 1:
        raise UserError("--record writes the record of one flight; leave --runs out")
    spec = load_spec_file(arguments.spec)
    if aircraft_of(spec) != "eav":
        raise UserError("--live flies only the EAV; to fly BIG BLUE in real time, use 'heronry demo'")
    drawn, ends = _drawn(spec, arguments), []
    for seed in range(arguments.seed, arguments.seed + arguments.runs):
        ends.append(fly_live(spec, spec_path(arguments.spec), drawn.of(spec, seed), arguments.record))
        print(json.dumps(ends[-1]) if arguments.json else _live_line(ends[-1]), flush=True)
    acceptable = sum(end["acceptable"] for end in ends)
    figures = {
        "runs": len(ends),
        "acceptable": acceptable,
        "interval": [round(bound, 4) for bound in interval(acceptable, len(ends))],
        "stood_still": sum(end["stood_still"] for end in ends),
        "latency_s": quantiles(sorted(ns / 1e9 for end in ends for ns in end["latencies_ns"]), 0.99),
    }
    if arguments.json:
        print(json.dumps(figures))
        return 0
    if len(ends) > 1:
        print(
            f"{acceptable} of {len(ends)} landings are acceptable; "
            f"the computer stood still in {figures['stood_still']} of the flights"
        )
    if figures["latency_s"]:
        print(latency_line(figures["latency_s"]))
    return 0


def _live_line(end: dict[str, Any]) -> str:
    landed = end["touchdown"]
    how = "acceptable" if end["acceptable"] else f"not acceptable ({', '.join(end['causes'])})"
    where = "" if landed is None else f": {landed['x_m']:.1f} m from the aim, sink {landed['sink_m_per_s']:.2f} m/s"
    still = f"; the plant was late by {end['longest_standstill_ms']:.0f} ms at most"
    return f"seed {end['seed']}: {how}{where}{still}"


def _flown(spec: Spec, kind: Kind, missions: Sequence[Any], arguments: argparse.Namespace) -> Iterator[Any]:
    if len(missions) > 1 or (arguments.record is None and arguments.report is None):
        yield from fly_all(spec_path(arguments.spec), missions, arguments.jobs, kind.fly)
        return
    landing, record = kind.fly_recorded(spec, missions[0])
    if arguments.record is not None:
        write_whole(arguments.record, record.as_json().encode())
    if arguments.report is not None:
        write_whole(arguments.report, flight_page(record).encode())
    yield landing


def _write_dispersion(file: Path, title: str, landings: Iterable[Dispersed]) -> None:
    write_whole(file, dispersion_page(title, list(landings)).encode())


def _missions(spec: Spec, name: str, arguments: argparse.Namespace) -> Sequence[Any]:
    """Return the missions of all seeds; raises UserError for an option that the aircraft does not have."""
    if name == "big_blue":
        return _glider_missions(spec, arguments)
    if arguments.phase is not None:
        raise UserError(
            "--phase: the EAV always begins on final, and only big_blue can begin in another phase; leave --phase out"
        )
    drawn = _drawn(spec, arguments)
    return [drawn.of(spec, seed) for seed in range(arguments.seed, arguments.seed + arguments.runs)]


def _glider_missions(spec: Spec, arguments: argparse.Namespace) -> Sequence[Any]:
    if arguments.without_rover or arguments.must_land or arguments.height_bias:
        raise UserError("--without-rover, --must-land and --height-bias are for the EAV: leave them out for big_blue")
    first = GliderMission(
        seed=arguments.seed,
        start=arguments.phase or "ascent",
        strongest_wind_m_per_s=_wind(arguments, glider_mission.STRONGEST_WIND_M_PER_S),
        blows=tuple(_blow(spec, text) for text in arguments.kill),
        acts=tuple(read_fault(spec, text) for text in arguments.act),
        judged=arguments.judged,
    )
    return missions(spec, first, arguments.runs, one_fault=arguments.one_fault)


def _wind(arguments: argparse.Namespace, default: float) -> float:
    wind: float = default if arguments.wind is None else arguments.wind
    if not 0.0 <= wind <= 15.0:
        raise UserError(f"--wind {wind:g}: the flight model is made for 0 to 15 m/s; write a number in this range")
    return wind


def _drawn(spec: Spec, arguments: argparse.Namespace) -> Drawn:
    lost = None if arguments.corrections_lost == NEVER else _number(arguments.corrections_lost, "--corrections-lost")
    first = Mission(
        seed=arguments.seed,
        strongest_wind_m_per_s=_wind(arguments, mission.STRONGEST_WIND_M_PER_S),
        corrections_lost_s=lost,
        has_rover=not arguments.without_rover,
        must_land=arguments.must_land,
        blows=tuple(_blow(spec, text) for text in arguments.kill),
        acts=tuple(read_fault(spec, text) for text in arguments.act),
        most_height_bias_m=arguments.height_bias,
        judged=arguments.judged,
        probed=arguments.latency,
    )
    return Drawn(first, arguments.one_fault)


def _blow(spec: Spec, text: str) -> Blow:
    what, _, when = text.rpartition("@")
    element, _, how = what.partition("=")
    kind, _, name = element.partition(":")
    known = {"pe": spec.pes, "bus": spec.buses, "device": spec.devices}.get(kind)
    if known is None:
        raise UserError(
            f"--kill {text}: write pe:NAME@WHEN, bus:NAME@WHEN or device:NAME@WHEN, for example pe:nav_a@20"
        )
    if name not in known:
        raise UserError(f"--kill {text}: no {kind_word(kind)} is named '{name}'; {meant(name, known)}")
    if how and kind != "device":
        raise UserError(f"--kill {text}: '={how}' can stand only after a device; leave '={how}' out")
    if how and how not in _HOW:
        raise UserError(f"--kill {text}: a device cannot fail in the way '{how}'; write one of {', '.join(_HOW)}")
    if when.endswith("m"):
        return Blow(element, below_m=_number(when[:-1], f"--kill {text}"), how=how or "dead")
    return Blow(element, at_s=_number(when, f"--kill {text}"), how=how or "dead")


def _number(text: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise UserError(f"{option}: '{text}' is not a number; write one from 0 to {_MOST}, for example 20") from None
    if not 0.0 <= value <= _MOST:
        raise UserError(f"{option}: {value:g} is not between 0 and {_MOST}")
    return value
