"""`heronry sim`: fly a spec in the simulator, inject faults, and check every flight.

Exit codes: 0 all is well; 1 an oracle was violated (the command that replays the flight is printed), or a given fault
was not injected; 2 the input cannot be used.
"""

import argparse
import json
import math
import shlex
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.number_arguments import flights, processors, whole_number
from heronry_tools.console.output import add_output
from heronry_tools.console.progress import Progress, show_line
from heronry_tools.console.spec_argument import add_spec_argument, load_spec_file, spec_path
from heronry_tools.sim.compiled.option import add_compiled_argument, go_on_compiled_if_asked
from heronry_tools.sim.faults.bounds import LONGEST_S, read_share, written_share

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.sim.faults.fault import Fault
    from heronry_tools.sim.flight.outcome import Outcome, Scenario

_DEFAULT_S = 5.0
_KEYED_EVERY = 4  # one pair of seeds in four has a key: an even seed, and an odd one, which has plans on board
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
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry sim`."""
    parser = subparsers.add_parser(
        "sim",
        description="Fly a spec in virtual time with the real cores and modules: same seed, same frames.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="first seed (default: 0)")
    parser.add_argument(
        "--runs",
        type=flights,
        default=1,
        metavar="N",
        help="number of flights (default: 1); the first has the seed of --seed, each further one the next seed",
    )
    parser.add_argument(
        "--seconds",
        type=seconds,
        metavar="S",
        help="inject faults up to second S, or until the faults of --act, --acts and --kill have ended, if that is "
        "later (default: up to second 5, or 1 s after these faults have ended, if that is later)",
    )
    parser.add_argument(
        "--jobs", type=processors, default=1, metavar="N", help="flights at a time (default: 1; 0: one per processor)"
    )
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
    add_compiled_argument(parser)
    add_output(parser, "write one JSON object per flight, and one for all flights")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly every seed; returns the exit code."""
    go_on_compiled_if_asked(arguments)
    from heronry_tools.sim.flight.campaign import Coverage, fly_all  # noqa: PLC0415 - the solver is slow to import
    from heronry_tools.sim.flight.flyable import check_images  # noqa: PLC0415
    from heronry_tools.sim.flight.outcome import play  # noqa: PLC0415

    spec = load_spec_file(arguments.spec)
    check_images(spec)
    scenarios = list(_scenarios(spec, arguments))
    coverage, failed = Coverage(spec, of_two=arguments.standby), 0
    show_line(f"flying {spec.name}: {len(scenarios)} flights" if len(scenarios) > 1 else f"flying {spec.name}")
    fly = _play_with_progress if len(scenarios) == 1 and not arguments.json else play
    for done, outcome in enumerate(fly_all(spec_path(arguments.spec), scenarios, arguments.jobs, fly), start=1):
        show_line("")
        coverage.add(outcome)
        failed += bool(outcome.violations)
        shown = _shrink(spec, arguments, outcome) if arguments.shrink and _is_wrong(outcome) else outcome
        lines = [json.dumps(_document(arguments, shown))] if arguments.json else _lines(arguments, shown)
        print("\n".join(lines), flush=True)
        if done < len(scenarios):
            show_line(f"{done} of {len(scenarios)} flights, {failed} failed")
    if len(scenarios) > 1:
        summary = {"flights": len(scenarios), "failed": failed, "coverage": coverage.document()}
        lines = [*coverage.table(), f"{len(scenarios)} flights, {failed} failed"]
        print(json.dumps(summary) if arguments.json else "\n".join(lines))
    elif not arguments.json:
        print("the flight FAILED" if failed else "the flight passed: no oracle was violated")
    return 1 if failed else 0


def _play_with_progress(spec: "Spec", scenario: "Scenario") -> "Outcome":
    """Simulate a flight, and show on a terminal how many of its seconds are flown."""
    from heronry_tools.sim.flight.outcome import play  # noqa: PLC0415 - the solver is slow to import

    with Progress() as progress:
        progress.begin(f"{spec.name}, seed {scenario.seed}: seconds flown", int(scenario.seconds))
        return play(spec, scenario, second_passed=progress.step)


def _scenarios(spec: "Spec", arguments: argparse.Namespace) -> Iterator["Scenario"]:
    from heronry_tools.sim.faults.drawing import drawn_faults  # noqa: PLC0415
    from heronry_tools.sim.faults.fault import KINDS, over_s, possible_targets  # noqa: PLC0415
    from heronry_tools.sim.flight.outcome import Scenario  # noqa: PLC0415

    unknown = [kind for kind in arguments.kind if kind not in KINDS]
    if unknown:
        raise UserError(f"--kind {unknown[0]}: no kind of fault has this name; the kinds are {', '.join(KINDS)}")
    idle = [kind for kind in arguments.kind if not possible_targets(spec, kind)]
    if idle:
        target = KINDS[idle[0]].target_kind
        words = {"twin_pe": "PE on a bus with two channels", "channel": "bus with two channels", "device": "sensor"}
        what = words.get(target, target.replace("_", " "))
        raise UserError(f"--kind {idle[0]}: {spec.name} has no {what} for a fault of this kind; name another kind")
    given = _given_faults(spec, arguments)
    needed_s = over_s(given)
    faults_s = max(_DEFAULT_S, needed_s + 1 if given else 0) if arguments.seconds is None else arguments.seconds
    for seed in range(arguments.seed, arguments.seed + arguments.runs):
        keyed = arguments.keyed or (not given and seed // 2 % _KEYED_EVERY == 0)
        faults = given or drawn_faults(spec, seed, faults_s, arguments.kind, of_two=arguments.standby, keyed=keyed)
        foreseen = 1 if arguments.foreseen is None and not given and seed % 2 else arguments.foreseen
        yield Scenario(
            seed,
            max(faults_s, needed_s),
            faults,
            arguments.loss,
            drawn=not given,
            keyed=keyed,
            standby=arguments.standby,
            foreseen=foreseen,
        )


def _given_faults(spec: "Spec", arguments: argparse.Namespace) -> tuple["Fault", ...]:
    from heronry_tools.runtime.demo.script import read_script  # noqa: PLC0415
    from heronry_tools.sim.faults.fault import MANAGER, Fault, is_one_of_two, read_fault  # noqa: PLC0415

    seats = {text: text.partition("@") for text in arguments.kill if is_one_of_two(text.partition("@")[0])}
    texts = [*arguments.act, *(f"{at} manager_crash {seat}" for seat, _, at in seats.values())]
    if arguments.acts is not None:
        texts += _lines_of(arguments.acts)
    faults = [read_fault(spec, text) for text in texts]
    absent = [fault for fault in faults if is_one_of_two(fault.target)]
    if absent and not arguments.standby:
        remedy = "write 'manager', or add --standby for a second one"
        raise UserError(f"'{absent[0]}': the flight has only one manager; {remedy}")
    script = read_script(spec, [text for text in arguments.kill if text not in seats], arguments.restore)
    for position, fault in enumerate(script):
        if fault.what == "kill":
            ends = [later.at_s for later in script[position + 1 :] if later.pe == fault.pe][:1]
            lasts_ms = max(1, round(1000 * (ends[0] - fault.at_s))) if ends else 0
            kind, target = ("manager_crash", MANAGER) if fault.pe == MANAGER else ("crash", f"pe:{fault.pe}")
            faults.append(Fault(round(1000 * fault.at_s), kind, target, lasts_ms))
    endless = [fault for fault in faults if fault.over_ms > 1000 * LONGEST_S]
    if endless:
        remedy = "write an earlier time, or a shorter fault"
        raise UserError(f"'{endless[0]}' begins or ends after {LONGEST_S} s, the longest flight; {remedy}")
    return tuple(sorted(faults))


def _lines_of(file: Path) -> list[str]:
    """Give the faults of a file, one per line, without comments and empty lines.

    Raises UserError if the file cannot be read, or lists no faults.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise UserError(f"--acts {file}: {error.strerror}; name a file with one fault per line") from None
    except UnicodeDecodeError:
        raise UserError(f"--acts {file}: the file is not text in UTF-8; name a file with one fault per line") from None
    told = [line for line in lines if line.strip() and not line.startswith("#")]
    if not told:
        raise UserError(f"--acts {file}: the file lists no faults; write one fault per line, or leave --acts out")
    return told


def _is_wrong(outcome: "Outcome") -> bool:
    """Tell whether a flight has a violation of any rule but MISSED.

    MISSED means that a fault which the user named was not injected.
    """
    from heronry_tools.sim.oracles.violation import MISSED  # noqa: PLC0415

    return any(violation.rule != MISSED for violation in outcome.violations)


def _shrink(spec: "Spec", arguments: argparse.Namespace, outcome: "Outcome") -> "Outcome":
    """Search for a shorter flight that fails, too, and write it to a scenario file."""
    from heronry_tools.sim.flight.outcome import play  # noqa: PLC0415
    from heronry_tools.sim.flight.shrink import shrunk  # noqa: PLC0415

    def fly(scenario: "Scenario") -> "Outcome":
        show_line(f"seed {scenario.seed}: trying {len(scenario.faults)} faults")
        return play(spec, scenario)

    least = shrunk(outcome, fly)
    show_line("")
    scenario = least.scenario
    why = [f"# {violation}" for violation in least.violations] + [f"# {_replay(arguments, scenario)}"]
    named = spec_path(arguments.spec).resolve() if Path(arguments.spec).suffix else arguments.spec
    lines = [
        f"spec {named}",
        f"seed {scenario.seed}",
        *([f"loss {written_share(scenario.loss)}"] if scenario.loss else []),
    ]
    lines += ["keyed"] if scenario.keyed else []
    lines += ["standby"] if scenario.standby else []
    lines += [] if scenario.foreseen is None else [f"contingencies {scenario.foreseen}"]
    lines += map(_line, scenario.faults)
    end_ms = math.ceil(1000 * scenario.seconds)
    text = "\n".join([*why, *lines, f"end {end_ms / 1000:.10g}s", ""])
    file = Path(f"{spec.name}-seed-{scenario.seed}.scenario")
    try:
        file.write_text(text)
    except OSError as error:
        print(
            f"heronry: {file} cannot be written ({error.strerror}); this is what it would hold:\n{text}",
            file=sys.stderr,
        )
    return least


def _line(fault: "Fault") -> str:
    """Write a fault as a line of a scenario file."""
    at, *words = str(fault).split()
    return " ".join(
        [f"at {at}s", *(f"{word}s" if before == "for" else word for before, word in pairwise(["", *words]))]
    )


def _lines(arguments: argparse.Namespace, outcome: "Outcome") -> list[str]:
    scenario = outcome.scenario
    faults = ", ".join(map(str, scenario.faults))
    end = f"{outcome.virtual_ns / 1e9:.1f} s, {outcome.frames} frames, digest {outcome.digest}"
    lines = [f"seed {scenario.seed}: {faults or 'no fault'} ({end})"]
    for told in outcome.reconfigurations if arguments.runs == 1 else ():
        times = "  ".join(f"{name} {ns / 1e6:6.1f}" for name, ns in told.times_ns.by_name().items() if ns is not None)
        lines.append(f"  {told.t_ns / 1e9:8.3f} s  epoch {told.epoch:<4} {times} ms  {told.causes[-1]}")
    if outcome.violations:
        lines += [f"  VIOLATION {violation}" for violation in outcome.violations]
        lines.append(f"  replay with: {_replay(arguments, scenario)}")
    return lines


def _document(arguments: argparse.Namespace, outcome: "Outcome") -> dict[str, Any]:
    return {
        "seed": outcome.scenario.seed,
        "acts": [str(fault) for fault in outcome.scenario.faults],
        "virtual_ns": outcome.virtual_ns,
        "frames": outcome.frames,
        "digest": outcome.digest,
        "hits": [{"kind": kind, "state": state, "count": n} for (kind, state), n in sorted(outcome.hits.items())],
        "reconfigurations": [
            {"t_ns": told.t_ns, "epoch": told.epoch, "causes": told.causes, "times_ns": told.times_ns.by_name()}
            for told in outcome.reconfigurations
        ],
        "violations": [{"t_ns": v.t_ns, "rule": v.rule, "story": v.story} for v in outcome.violations],
        "replay": _replay(arguments, outcome.scenario),
    }


def _replay(arguments: argparse.Namespace, scenario: "Scenario") -> str:
    words = ["heronry", "sim", arguments.spec, "--seed", str(scenario.seed), "--seconds", f"{scenario.seconds:.10g}"]
    if scenario.drawn:
        words += [word for kind in arguments.kind for word in ("--kind", kind)]
    else:
        words += [word for fault in scenario.faults for word in ("--act", str(fault))]
    words += ["--keyed"] if scenario.keyed else []
    words += ["--standby"] if scenario.standby else []
    words += [] if scenario.foreseen is None else ["--foreseen", str(scenario.foreseen)]
    return shlex.join(words + (["--loss", written_share(scenario.loss)] if scenario.loss else []))


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
