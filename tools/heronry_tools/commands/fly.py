"""`heronry fly`: an aircraft in a flight dynamics model, flown by its avionics on simulated PEs and buses.

Exit codes: 0 flown (whatever the landing was like); 1 an oracle was violated (--judged); 2 the input cannot be used.
"""

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.number_arguments import flights, processors, whole_number
from heronry_tools.console.output import add_output, expect_ending
from heronry_tools.console.progress import show_line
from heronry_tools.console.spec_argument import FLOWN, load_spec_file, spec_path
from heronry_tools.console.whole_file import expect_writable, write_whole
from heronry_tools.sim.compiled.option import add_compiled_argument, go_on_compiled_if_asked
from heronry_wire.spelling import kind_word, meant

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.fly.campaign import Drawn
    from heronry_tools.fly.kinds import Kind
    from heronry_tools.fly.mission import Blow
    from heronry_tools.fly.report.dispersion_page import Landing as Dispersed

_NEVER = "never"
_MOST = 100_000  # largest number of an option, in s or in m of height: more than any flight needs
_PHASES = ("ascent", "deployment", "glide", "landing")
_HOW = ("dead", "stuck", "bias", "loose")
_EPILOG = """\
The EAV is on final, 620 m before the aiming point. After two seconds its differential receiver loses its corrections: a
monitor on board finds that, the manager plans anew, and the tracking filter lands the aircraft by the angles at which
the camera of a rover beside the runway sees it. All data go through modules of the spec and frames on its buses, as the
running plan wires them.

A landing is acceptable with a sink rate of at most 1.5 m/s, within 7.2 m of the centre line and -60 to 90 m of the aim,
a bank of at most 10 degrees, a pitch of 0 to 14 degrees, and if wheels alone touch the ground. Where the plan has no
position that is good enough, the flight management goes around; with --must-land it lands all the same.

BIG BLUE goes up under its balloon, fills its wings above 15 km, is cut loose near 20 km, and glides home; the phases of
the spec are entered by their own rules. On the line, where surfaces have no effect, time passes 30 times faster. Its
landing is acceptable within 500 m of home, with a sink of at most 3 m/s, and if its skids alone touch the ground.

A fault is ELEMENT@WHEN: an element is pe:NAME, bus:NAME or device:NAME (with =dead, =stuck, =bias or =loose), WHEN is
seconds of the flight, or a height (10m) below which it happens. Wind is drawn by the seed, up to 7.7 m/s at 20 ft and
60 degrees from the runway's direction, with turbulence. The same seed gives the same flight, bit for bit, with the same
digest.

Exit codes: 0 flown, whatever the landing was like; 1 an oracle was violated (--judged); 2 the input cannot be used;
130 and 143 ended by Ctrl-C and by SIGTERM.

examples:
  heronry fly eav                                      one landing
  heronry fly eav --without-rover                      no landing: it goes around
  heronry fly eav --without-rover --must-land          ... it lands all the same
  heronry fly eav --kill bus:radio@10m                 the radio dies below 10 m
  heronry fly eav --kill device:elevator_1=stuck@20    a servo sticks after 20 s
  heronry fly eav --act '5 collapse bus:radio for 60 level 10'    the radio keeps a tenth of its bit rate
  heronry fly eav --runs 100 --jobs 0 --compiled       a campaign: the share of acceptable landings
  heronry fly eav --live                               in real time, each PE a process
  heronry fly eav --runs 100 --one-fault --json        each seed draws a PE, the radio or a servo that fails
  heronry fly eav --report landing.html                one landing, with its pictures
  heronry fly eav --corrections-lost never --height-bias 4 --runs 60    up to which error of height it can land
  heronry fly big_blue --report flight.html            from the ground to the ground (two hours; takes a while)
  heronry fly big_blue --phase glide --kill pe:nav@60  released at 2 km; a PE dies after a minute
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry fly`."""
    parser = subparsers.add_parser(
        "fly",
        description="Let the avionics land an aircraft that a flight dynamics model simulates, in virtual time.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "spec",
        metavar="SPEC",
        help=f"a spec with the devices of the EAV or of BIG BLUE; shipped: {', '.join(FLOWN)}, big_blue",
    )
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="first seed (default: 0)")
    parser.add_argument(
        "--runs",
        type=flights,
        default=1,
        metavar="N",
        help="number of flights (default: 1); the first has the seed of --seed, each further one the next seed",
    )
    parser.add_argument(
        "--jobs", type=processors, default=1, metavar="N", help="flights at a time (default: 1; 0: one per processor)"
    )
    parser.add_argument(
        "--without-rover",
        action="store_true",
        help="eav: no rover stands beside the runway to watch the landing with its camera",
    )
    parser.add_argument(
        "--must-land",
        action="store_true",
        help="eav: order the phase must_land as soon as the flight begins",
    )
    parser.add_argument(
        "--corrections-lost",
        default="2",
        metavar="S",
        help=f"eav: the differential receiver loses its corrections after S s; S may be '{_NEVER}' (default: 2)",
    )
    parser.add_argument(
        "--height-bias",
        type=float,
        default=0.0,
        metavar="M",
        help="eav: add a constant error to the height of the differential receiver, drawn from -M to M metres; "
        "no monitor finds this error",
    )
    parser.add_argument(
        "--wind", type=float, metavar="M/S", help="strongest wind that is drawn, in m/s (default: EAV 7.7, BIG BLUE 5)"
    )
    parser.add_argument("--phase", choices=_PHASES, help="begin in this phase (big_blue only; default: on the ground)")
    parser.add_argument(
        "--kill",
        action="append",
        default=[],
        metavar="ELEMENT@WHEN",
        help="inject this fault (see below); may be repeated",
    )
    parser.add_argument(
        "--act",
        action="append",
        default=[],
        metavar="ACT",
        help="inject this fault, written as for 'heronry sim --act'; its seconds count from the start of the flight; "
        "may be repeated; with --live only faults of a bus",
    )
    parser.add_argument(
        "--one-fault", action="store_true", help="inject one fault; the seed decides which one, and when"
    )
    parser.add_argument("--judged", action="store_true", help="check each flight by the oracles of 'heronry sim'")
    parser.add_argument("--latency", action="store_true", help="measure the delay from sensor to servo, in still air")
    parser.add_argument("--live", action="store_true", help="eav: fly in real time, with processes on software buses")
    parser.add_argument("--record", type=Path, metavar="FILE", help="write the record as JSON; for one flight only")
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write an HTML page with pictures: of the flight, or of all flights"
    )
    add_compiled_argument(parser)
    add_output(parser, "write one JSON object per flight, and one for all")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly every seed; returns the exit code."""
    for file, ending in ((arguments.record, ".json"), (arguments.report, ".html")):
        if file is not None:  # checked now, so that a wrong name is reported before the flight
            expect_ending(file, {ending[1:]: (ending,)})
            expect_writable(file)
    if arguments.live:
        return _run_live(arguments)
    go_on_compiled_if_asked(arguments)
    from heronry_tools.fly.kinds import KINDS, aircraft_of  # noqa: PLC0415 - the simulator is slow to import

    spec = load_spec_file(arguments.spec)
    name = aircraft_of(spec)
    kind = KINDS[name]
    missions = _missions(spec, name, arguments)
    if arguments.record is not None and arguments.runs > 1:
        raise UserError("--record writes the record of one flight; leave --runs out")
    landings = []
    for landing in _flown(spec, kind, missions, arguments):
        show_line("")
        landings.append(landing)
        print(json.dumps(landing.document()) if arguments.json else kind.line(landing), flush=True)
        if len(landings) < arguments.runs:
            show_line(f"{len(landings)} of {arguments.runs} flights")
    if arguments.json or len(landings) > 1 or arguments.latency:
        found = kind.summary(landings)
        print(json.dumps(found) if arguments.json else kind.figures(found))
    if arguments.report is not None and len(landings) > 1:
        _write_dispersion(arguments.report, f"{spec.name}: {len(landings)} flights", map(kind.dispersed, landings))
    return 1 if any(landing.violations for landing in landings) else 0


def _run_live(arguments: argparse.Namespace) -> int:
    """Fly the seeds in real time, one after the other; returns the exit code."""
    from heronry_tools.fly.acceptance import interval  # noqa: PLC0415
    from heronry_tools.fly.campaign import latency_line, quantiles  # noqa: PLC0415
    from heronry_tools.fly.kinds import aircraft_of  # noqa: PLC0415
    from heronry_tools.fly.live.flight import fly_live  # noqa: PLC0415

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


def _flown(spec: "Spec", kind: "Kind", missions: Sequence[Any], arguments: argparse.Namespace) -> Iterator[Any]:
    from heronry_tools.fly.report import flight_page  # noqa: PLC0415
    from heronry_tools.sim.flight.campaign import fly_all  # noqa: PLC0415

    if len(missions) > 1 or (arguments.record is None and arguments.report is None):
        yield from fly_all(spec_path(arguments.spec), missions, arguments.jobs, kind.fly)
        return
    landing, record = kind.fly_recorded(spec, missions[0])
    if arguments.record is not None:
        write_whole(arguments.record, record.as_json().encode())
    if arguments.report is not None:
        write_whole(arguments.report, flight_page(record).encode())
    yield landing


def _write_dispersion(file: Path, title: str, landings: Iterable["Dispersed"]) -> None:
    from heronry_tools.fly.report import dispersion_page  # noqa: PLC0415

    write_whole(file, dispersion_page(title, list(landings)).encode())


def _missions(spec: "Spec", name: str, arguments: argparse.Namespace) -> Sequence[Any]:
    """Give the missions of all seeds; raises UserError for an option that the aircraft does not have."""
    if name == "big_blue":
        return _glider_missions(spec, arguments)
    if arguments.phase is not None:
        raise UserError(
            "--phase: the EAV always begins on final, and only big_blue can begin in another phase; leave --phase out"
        )
    drawn = _drawn(spec, arguments)
    return [drawn.of(spec, seed) for seed in range(arguments.seed, arguments.seed + arguments.runs)]


def _glider_missions(spec: "Spec", arguments: argparse.Namespace) -> Sequence[Any]:
    from heronry_tools.fly.glider_campaign import missions  # noqa: PLC0415
    from heronry_tools.fly.glider_mission import STRONGEST_WIND_M_PER_S, GliderMission  # noqa: PLC0415
    from heronry_tools.sim.faults.fault import read_fault  # noqa: PLC0415

    if arguments.without_rover or arguments.must_land or arguments.height_bias:
        raise UserError("--without-rover, --must-land and --height-bias are for the EAV: leave them out for big_blue")
    first = GliderMission(
        seed=arguments.seed,
        start=arguments.phase or "ascent",
        strongest_wind_m_per_s=_wind(arguments, STRONGEST_WIND_M_PER_S),
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


def _drawn(spec: "Spec", arguments: argparse.Namespace) -> "Drawn":
    from heronry_tools.fly.campaign import Drawn  # noqa: PLC0415
    from heronry_tools.fly.mission import STRONGEST_WIND_M_PER_S, Mission  # noqa: PLC0415
    from heronry_tools.sim.faults.fault import read_fault  # noqa: PLC0415

    lost = None if arguments.corrections_lost == _NEVER else _number(arguments.corrections_lost, "--corrections-lost")
    mission = Mission(
        seed=arguments.seed,
        strongest_wind_m_per_s=_wind(arguments, STRONGEST_WIND_M_PER_S),
        corrections_lost_s=lost,
        has_rover=not arguments.without_rover,
        must_land=arguments.must_land,
        blows=tuple(_blow(spec, text) for text in arguments.kill),
        acts=tuple(read_fault(spec, text) for text in arguments.act),
        most_height_bias_m=arguments.height_bias,
        judged=arguments.judged,
        probed=arguments.latency,
    )
    return Drawn(mission, arguments.one_fault)


def _blow(spec: "Spec", text: str) -> "Blow":
    from heronry_tools.fly.mission import Blow  # noqa: PLC0415

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
