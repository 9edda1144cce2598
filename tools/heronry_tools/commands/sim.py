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
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.flight_limits import LONGEST_S, written_share
from heronry_tools.console.progress import Progress, show_line
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.runtime.demo.script import read_script
from heronry_tools.sim.compiled.machine_code import go_on_compiled
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.faults.fault import KINDS, MANAGER, Fault, is_one_of_two, over_s, possible_targets, read_fault
from heronry_tools.sim.flight.campaign import Coverage, fly_all
from heronry_tools.sim.flight.flyable import check_images, reload_file
from heronry_tools.sim.flight.outcome import Outcome, Scenario, play
from heronry_tools.sim.flight.shrink import shrunk
from heronry_tools.sim.oracles.violation import MISSED

_DEFAULT_S = 5.0
_KEYED_EVERY = 4  # one pair of seeds in four has a key: an even seed, and an odd one, which has plans on board


def run(arguments: argparse.Namespace) -> int:
    """Fly every seed; returns the exit code."""
    if arguments.compiled:
        go_on_compiled(arguments.argv)

    spec = load_spec_file(arguments.spec)
    check_images(spec)
    if arguments.shrink and arguments.reload is not None:
        raise UserError("--shrink: a scenario file orders a reload only once; leave --shrink out, or --reload")
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


def _play_with_progress(spec: Spec, scenario: Scenario) -> Outcome:
    """Simulate a flight, and show on a terminal how many of its seconds are flown."""
    with Progress() as progress:
        progress.begin(f"{spec.name}, seed {scenario.seed}: seconds flown", int(scenario.seconds))
        return play(spec, scenario, second_passed=progress.step)


def _scenarios(spec: Spec, arguments: argparse.Namespace) -> Iterator[Scenario]:
    unknown = [kind for kind in arguments.kind if kind not in KINDS]
    if unknown:
        raise UserError(f"--kind {unknown[0]}: no kind of fault has this name; the kinds are {', '.join(KINDS)}")
    idle = [kind for kind in arguments.kind if not possible_targets(spec, kind)]
    if idle:
        target = KINDS[idle[0]].target_kind
        words = {
            "twin_pe": "PE on a bus with two channels",
            "channel": "bus with two channels",
            "device": "sensor",
            "kept_place": "module with a checkpoint that may run on two PEs",
        }
        what = words.get(target, target.replace("_", " "))
        raise UserError(f"--kind {idle[0]}: {spec.name} has no {what} for a fault of this kind; name another kind")
    given, reload = _given_faults(spec, arguments), reload_file(spec, arguments.reload)
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
            reload=reload,
        )


def _given_faults(spec: Spec, arguments: argparse.Namespace) -> tuple[Fault, ...]:
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
    """Return the faults of a file, one per line, without comments and empty lines.

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


def _is_wrong(outcome: Outcome) -> bool:
    """Tell whether a flight has a violation, other than that a fault of the user was not injected (MISSED)."""
    return any(violation.rule != MISSED for violation in outcome.violations)


def _shrink(spec: Spec, arguments: argparse.Namespace, outcome: Outcome) -> Outcome:
    """Search for a shorter flight that fails, too, and write it to a scenario file."""

    def fly(scenario: Scenario) -> Outcome:
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


def _line(fault: Fault) -> str:
    """Write a fault as a line of a scenario file."""
    at, *words = str(fault).split()
    return " ".join(
        [f"at {at}s", *(f"{word}s" if before == "for" else word for before, word in pairwise(["", *words]))]
    )


def _lines(arguments: argparse.Namespace, outcome: Outcome) -> list[str]:
    scenario = outcome.scenario
    faults = ", ".join(map(str, scenario.faults))
    end = f"{outcome.virtual_ns / 1e9:.1f} s, {outcome.frames} frames, digest {outcome.digest}"
    end += f", {outcome.reloaded}" if outcome.reloaded else ""
    lines = [f"seed {scenario.seed}: {faults or 'no fault'} ({end})"]
    for told in outcome.reconfigurations if arguments.runs == 1 else ():
        times = "  ".join(f"{name} {ns / 1e6:6.1f}" for name, ns in told.times_ns.by_name().items() if ns is not None)
        lines.append(f"  {told.t_ns / 1e9:8.3f} s  epoch {told.epoch:<4} {times} ms  {told.causes[-1]}")
    if outcome.violations:
        lines += [f"  VIOLATION {violation}" for violation in outcome.violations]
        lines.append(f"  replay with: {_replay(arguments, scenario)}")
    return lines


def _document(arguments: argparse.Namespace, outcome: Outcome) -> dict[str, Any]:
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
        **({"reloaded": outcome.reloaded} if outcome.reloaded else {}),
        "violations": [{"t_ns": v.t_ns, "rule": v.rule, "story": v.story} for v in outcome.violations],
        "replay": _replay(arguments, outcome.scenario),
    }


def _replay(arguments: argparse.Namespace, scenario: Scenario) -> str:
    words = ["heronry", "sim", arguments.spec, "--seed", str(scenario.seed), "--seconds", f"{scenario.seconds:.10g}"]
    if scenario.drawn:
        words += [word for kind in arguments.kind for word in ("--kind", kind)]
    else:
        words += [word for fault in scenario.faults for word in ("--act", str(fault))]
    words += ["--keyed"] if scenario.keyed else []
    words += ["--standby"] if scenario.standby else []
    words += [] if scenario.foreseen is None else ["--foreseen", str(scenario.foreseen)]
    words += [] if arguments.reload is None else ["--reload", arguments.reload]
    return shlex.join(words + (["--loss", written_share(scenario.loss)] if scenario.loss else []))
