"""The command line of `heronry sim`: arguments, their help, and examples."""

import argparse
import math
from pathlib import Path
from typing import Any

from heronry_tools.console.flight_arguments import add_compiled_argument, add_jobs_argument, add_seed_arguments
from heronry_tools.console.flight_limits import LONGEST_S, read_share
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
Each seed draws its own faults (crashes, pauses, broken wires, noise, foreign nodes on the bus, a manager that dies, an
operator who errs, ...), of kinds that it draws first; --act, --acts, --kill and --restore give them instead. Seconds
are virtual and count from the moment at which the first configuration runs. A seed replays a flight bit for bit. Where
a seed draws the faults and is odd, plans for every single fault are on board (--foreseen 1). Where seeds draw the
faults, one pair of seeds in four flies with a key (--keyed); then an attacker forges commands.

Oracles check every flight, without access to a core: nothing exclusive ever has two drivers, one epoch is one legal
configuration, no healthy element is reported as failed, no old datum is taken for a new one, and no PE stops because
the manager is silent. At the end all faults are removed. Then every healthy PE must become active, the plan must be the
best one, and its outputs must be heard on the bus.

A fault is written SECONDS KIND ELEMENT [for SECONDS] [in STATE] [level NUMBER]. A fault with a STATE waits for it, for
three seconds at most. A given fault that is not injected, or not in that state, fails the flight.

With --standby there are two managers, each with a journal on a disk of its own, and more faults are drawn. A manager
loses power while it writes, cannot receive or transmit, is started twice, or has a full disk. A bus breaks between the
managers, with PEs on either side. A PE has an old table. In flights with a key, an attacker without it forges, replays,
reorders and truncates commands. Then the oracles also check: one manager is active in a term, no PE goes back to an
older term, every command that a PE executed was authentic and fresh, and the journal agrees with the flight.

Exit codes: 0 all is well; 1 an oracle was violated, or a given fault was not injected; 2 the input cannot be
used; 130 and 143 ended by Ctrl-C and by SIGTERM.

examples:
  heronry sim big_blue                              one flight, with what seed 0 draws
  heronry sim big_blue --runs 100 --seconds 60      the seeds 0 to 99
  heronry sim big_blue --act '1 pause pe:nav for 0.3' --act '1.1 manager_crash manager for 0.5 in planning'
  heronry sim big_blue --kill pe:nav@1 --kill pe:flight@1.05 --restore pe:nav@2
  heronry sim big_blue --runs 2000 --seconds 60 --jobs 0 --compiled      a serious campaign
  heronry sim big_blue --standby --act '1 manager_power primary for 0.5' --act '2 manager_pause standby for 0.3'
  heronry sim my.dg.yaml --runs 50 --loss 0.01      one frame in a hundred is destroyed, one in a thousand missed
  heronry sim big_blue --keyed --kind attack        with a key, and an attacker on the bus without it
  heronry sim my.dg.yaml --reload new.dg.yaml --runs 50 --seconds 20     changes to another spec in flight
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry sim`."""
    parser = subparsers.add_parser(
        "sim",
        description="Fly a spec in virtual time with the real cores and modules: same seed, same frames.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    add_seed_arguments(parser)
    parser.add_argument(
        "--seconds",
        type=seconds,
        metavar="S",
        help="inject faults up to second S, or until the faults of --act, --acts and --kill have ended, if that is "
        "later (default: up to second 5, or 1 s after these faults have ended, if that is later)",
    )
    add_jobs_argument(parser)
    parser.add_argument("--kind", action="append", default=[], metavar="KIND", help="draw only faults of this kind")
    parser.add_argument(
        "--act", action="append", default=[], metavar="ACT", help="inject this fault, and draw none; may be repeated"
    )
    parser.add_argument("--acts", type=Path, metavar="FILE", help="inject the faults of this file, one per line")
    parser.add_argument(
        "--kill",
        action="append",
        default=[],
        metavar="pe:NAME@S",
        help="kill a PE, or a manager (manager, primary, standby), at second S",
    )
    parser.add_argument(
        "--restore", action="append", default=[], metavar="pe:NAME@S", help="start a killed node again at second S"
    )
    parser.add_argument("--standby", action="store_true", help="fly with two managers, and draw their faults, too")
    parser.add_argument(
        "--loss", type=share, default=0.0, metavar="P", help="share of frames that are lost, 0 to 0.5 (default: 0)"
    )
    parser.add_argument(
        "--foreseen",
        choices=(0, 1, 2),
        type=int,
        metavar="N",
        help="make plans ahead for up to N faults, and put the plans on board (default: by the seed, see below)",
    )
    parser.add_argument(
        "--keyed",
        action="store_true",
        help="give managers and PEs a key in every flight (default: by the seed, see below)",
    )
    parser.add_argument(
        "--shrink",
        action="store_true",
        help="if a flight fails, look for a smaller set of its faults with which it still fails; write that set to"
        " SPEC-seed-N.scenario",
    )
    parser.add_argument(
        "--reload",
        metavar="FILE",
        help="in each flight the operator orders the change to the spec in this file, at a time that the seed draws",
    )
    add_compiled_argument(parser)
    add_output(parser, "write one JSON object per flight, and one for all flights")


def seconds(text: str) -> float:
    """Read the length of a flight in seconds, 0 to LONGEST_S; raises ArgumentTypeError for any other text."""
    try:
        duration = float(text)
    except ValueError:
        duration = math.nan
    if not 0 <= duration <= LONGEST_S:
        raise argparse.ArgumentTypeError(f"{text} is not a flight time; write 0 to {LONGEST_S} seconds")
    return duration


def share(text: str) -> float:
    """Read a share of lost frames, from 0 to 0.5; raises ArgumentTypeError for any other text."""
    probability = read_share(text)
    if probability is None:
        raise argparse.ArgumentTypeError(f"{text} is not a share of lost frames; write a number from 0 to 0.5")
    return probability
