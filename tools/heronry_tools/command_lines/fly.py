"""The command line of `heronry fly`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.flight_arguments import add_compiled_argument, add_jobs_argument, add_seed_arguments
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import FLOWN

NEVER = "never"
_PHASES = ("ascent", "deployment", "glide", "landing")
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
    add_seed_arguments(parser)
    add_jobs_argument(parser)
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
        help=f"eav: the differential receiver loses its corrections after S s; S may be '{NEVER}' (default: 2)",
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
