"""`heronry fly`: an aircraft in a flight dynamics model, flown by its avionics on simulated PEs and buses.

Exit codes: 0 flown (whatever the landing was like); 1 an oracle was violated (--judged); 2 the input cannot be used.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.number_arguments import flights, processors, whole_number
from heronry_tools.console.output import add_json
from heronry_tools.console.progress import show_line
from heronry_tools.console.spec_argument import FLOWN, load_spec_file, spec_path
from heronry_tools.console.whole_file import write_whole
from heronry_tools.sim.compiled.option import add_compiled_argument, go_on_compiled_if_asked

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.fly.campaign import Drawn
    from heronry_tools.fly.mission import Blow, Landing

_NEVER = "never"
_HOW = ("dead", "stuck", "bias", "loose")
_EPILOG = """\
The EAV is on final, 620 m before the aiming point. After two seconds its differential receiver loses its corrections: a
monitor on board finds that, the manager plans anew, and the tracking filter lands the aircraft by the angles at which
the camera of a rover beside the runway sees it. Every datum passes the modules of the spec, frames and plans.

A landing is acceptable with a sink rate of at most 1.5 m/s, within 7.2 m of the centre line and -60 to 90 m of the aim,
a bank of at most 10 degrees, a pitch of 0 to 14 degrees, and if wheels alone touch the ground. Where the plan has no
position that is good enough, the flight management goes around; with --must-land it lands all the same.

A fault is ELEMENT@WHEN: an element is pe:NAME, bus:NAME or device:NAME (with =dead, =stuck, =bias or =loose), WHEN is
seconds of the flight, or a height (10m) below which it happens. Wind is drawn by the seed, up to 7.7 m/s at 20 ft and
60 degrees from the runway's direction, with turbulence. One seed is one flight, to the bit: the digest tells.

Exit codes: 0 flown, whatever the landing was like; 1 an oracle was violated (--judged); 2 the input cannot be used;
130 and 143 ended by Ctrl-C and by SIGTERM.

examples:
  heronry fly eav                                      one landing
  heronry fly eav --without-rover                      no landing: it goes around
  heronry fly eav --without-rover --must-land          as it must end
  heronry fly eav --kill bus:radio@10m                 the radio dies below 10 m
  heronry fly eav --kill device:elevator_1=stuck@20    a servo sticks after 20 s
  heronry fly eav --runs 100 --jobs 0 --compiled       a campaign, with the interval of its share
  heronry fly eav --runs 100 --one-fault --json        each seed draws a PE, the radio or a servo that fails
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry fly`."""
    parser = subparsers.add_parser(
        "fly",
        description="Land an aircraft of a flight dynamics model by its avionics, in virtual time.",
        epilog=_EPILOG,
    )
    parser.add_argument("spec", metavar="SPEC", help=f"a spec with the EAV's devices, or {', '.join(FLOWN)}")
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="first seed (default: 0)")
    parser.add_argument("--runs", type=flights, default=1, metavar="N", help="number of seeds, one after the other")
    parser.add_argument(
        "--jobs", type=processors, default=1, metavar="N", help="flights at a time (default: 1; 0: one per processor)"
    )
    parser.add_argument("--without-rover", action="store_true", help="no rover stands beside the runway")
    parser.add_argument("--must-land", action="store_true", help="the operator orders the phase must_land")
    parser.add_argument(
        "--corrections-lost",
        default="2",
        metavar="S",
        help=f"when the differential receiver becomes inaccurate (default: 2; {_NEVER})",
    )
    parser.add_argument("--wind", type=float, default=7.7, metavar="M/S", help="strongest wind drawn (default: 7.7)")
    parser.add_argument(
        "--kill", action="append", default=[], metavar="ELEMENT@WHEN", help="a fault: see below; may be given again"
    )
    parser.add_argument("--one-fault", action="store_true", help="each seed draws one fault at a time on final")
    parser.add_argument("--judged", action="store_true", help="the oracles of 'heronry sim' look on")
    parser.add_argument("--record", type=Path, metavar="FILE", help="write the record of the one flight as JSON")
    add_compiled_argument(parser)
    add_json(parser, "write one JSON object per flight, and one for all")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly every seed; returns the exit code."""
    go_on_compiled_if_asked(arguments)
    from heronry_tools.fly.campaign import summary  # noqa: PLC0415 - the simulator is slow to import

    spec = load_spec_file(arguments.spec)
    drawn = _drawn(spec, arguments)
    if arguments.record is not None and arguments.runs > 1:
        raise UserError("--record writes the record of one flight; leave --runs out")
    landings = []
    for landing in _flown(spec, drawn, arguments):
        show_line("")
        landings.append(landing)
        print(json.dumps(landing.document()) if arguments.json else _line(landing), flush=True)
        if len(landings) < arguments.runs:
            show_line(f"{len(landings)} of {arguments.runs} flights")
    if arguments.json or len(landings) > 1:
        figures = summary(landings)
        print(json.dumps(figures) if arguments.json else _figures(figures))
    return 1 if any(landing.violations for landing in landings) else 0


def _flown(spec: "Spec", drawn: "Drawn", arguments: argparse.Namespace) -> Iterator["Landing"]:
    from heronry_tools.fly.flight import EavFlight, fly_landing  # noqa: PLC0415
    from heronry_tools.sim.flight.campaign import fly_all  # noqa: PLC0415

    missions = [drawn.of(spec, seed) for seed in range(arguments.seed, arguments.seed + arguments.runs)]
    if arguments.record is None:
        yield from fly_all(spec_path(arguments.spec), missions, arguments.jobs, fly_landing)
        return
    landing, record = EavFlight(spec, missions[0]).fly()
    write_whole(arguments.record, record.as_json().encode())
    yield landing


def _drawn(spec: "Spec", arguments: argparse.Namespace) -> "Drawn":
    from heronry_tools.fly.campaign import Drawn  # noqa: PLC0415
    from heronry_tools.fly.mission import Mission  # noqa: PLC0415

    lost = None if arguments.corrections_lost == _NEVER else _seconds(arguments.corrections_lost, "--corrections-lost")
    if not 0.0 <= arguments.wind <= 15.0:
        raise UserError(f"--wind {arguments.wind:g}: the model is made for 0 to 15 m/s")
    mission = Mission(
        seed=arguments.seed,
        strongest_wind_m_per_s=arguments.wind,
        corrections_lost_s=lost,
        has_rover=not arguments.without_rover,
        must_land=arguments.must_land,
        blows=tuple(_blow(spec, text) for text in arguments.kill),
        judged=arguments.judged,
    )
    return Drawn(mission, arguments.one_fault)


def _blow(spec: "Spec", text: str) -> "Blow":
    from heronry_tools.fly.mission import Blow  # noqa: PLC0415

    what, _, when = text.rpartition("@")
    element, _, how = what.partition("=")
    kind, _, name = element.partition(":")
    known = {"pe": spec.pes, "bus": spec.buses, "device": spec.devices}.get(kind)
    if known is None or name not in known:
        raise UserError(
            f"--kill {text}: write pe:NAME@WHEN, bus:NAME@WHEN or device:NAME@WHEN, with a name of the spec"
        )
    if how and (kind != "device" or how not in _HOW):
        raise UserError(f"--kill {text}: a device may be {', '.join(_HOW)}; nothing else has a way to fail")
    if when.endswith("m"):
        return Blow(element, below_m=_seconds(when[:-1], f"--kill {text}"), how=how or "dead")
    return Blow(element, at_s=_seconds(when, f"--kill {text}"), how=how or "dead")


def _seconds(text: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise UserError(f"{option}: '{text}' is not a number") from None
    if not 0.0 <= value <= 1000.0:
        raise UserError(f"{option}: {value:g} is not between 0 and 1000")
    return value


def _line(landing: "Landing") -> str:
    """Say in one line how a flight ended."""
    blows = "".join(f", {blow}" for blow in landing.mission.blows)
    head = f"seed {landing.mission.seed}{blows}: "
    landed = landing.touchdown
    if landed is None:
        how = "goes around, landing refused" if landing.went_around else "has not landed"
        return f"{head}{how}; digest {landing.digest}"
    judged = "acceptable" if not landing.causes else f"not acceptable ({', '.join(landing.causes)})"
    where = f"{landed.x_m:.1f} m from the aim, {landed.y_m:+.1f} m from the centre line"
    return f"{head}lands {judged}: {where}, sink {landed.sink_m_per_s:.2f} m/s; digest {landing.digest}"


def _figures(figures: dict[str, Any]) -> str:
    low, high = figures["interval"]
    causes = ", ".join(f"{cause} {count}" for cause, count in figures["causes"].items()) or "none"
    share = 100 * figures["acceptable"] / figures["runs"]
    interval = f"{share:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f}"
    lines = [
        f"{figures['acceptable']} of {figures['runs']} landings are acceptable ({interval})",
        f"causes: {causes}; went around: {figures['went_around']}",
    ]
    if figures["sink_m_per_s"]:
        lines.append("sink rate: median {:.2f} m/s, 95 % below {:.2f} m/s".format(*figures["sink_m_per_s"]))
    if figures["height_error_below_1_5_m"] is not None:
        lines.append(f"height error below 10 m stays below 1.5 m in {100 * figures['height_error_below_1_5_m']:.1f} %")
    if figures["reconfigured_after_s"]:
        middle, most = figures["reconfigured_after_s"]
        lines.append(f"reconfigured after a fault: median {middle:.3f} s, 99 % within {most:.3f} s")
    return "\n".join(lines)
