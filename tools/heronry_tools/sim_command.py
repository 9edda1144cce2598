"""`heronry sim`: fly a spec in the simulator, disturb it, and judge what came of it.

Exit codes: 0 all is well; 1 something was violated, and the one command that replays it is printed; 2 the input cannot
be used.
"""

import argparse
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from heronry_tools.errors import UserError
from heronry_tools.spec_argument import add_spec_argument

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.simulator.scenario import Outcome, Scenario

_EPILOG = """\
Without --kill and --restore each seed draws its own: one to three PEs die, and most of them come back. Seconds are
virtual and count from the moment at which the first configuration runs. A seed replays a flight bit for bit.

What is judged, from the frames alone: nothing exclusive ever has two drivers, one epoch is one configuration, nobody
who is well is blamed; and in the end every healthy PE is active and all of class A to D that could be served is heard.

examples:
  heronry sim big_blue                              one flight, with the losses that seed 0 draws
  heronry sim big_blue --runs 100                   the seeds 0 to 99
  heronry sim big_blue --kill pe:nav@1 --kill pe:flight@1.05 --restore pe:nav@2
  heronry sim my.dg.yaml --runs 50 --loss 0.01      one frame in a hundred is destroyed, one in a thousand missed
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry sim`."""
    parser = subparsers.add_parser(
        "sim",
        help="fly a spec in the simulator and judge what comes of it",
        description="Fly a spec in virtual time with the real cores and modules: same seed, same frames.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_spec_argument(parser)
    parser.add_argument("--seed", type=whole_number, default=0, metavar="N", help="first seed (default: 0)")
    parser.add_argument("--runs", type=whole_number, default=1, metavar="N", help="how many seeds, one after the other")
    parser.add_argument("--seconds", type=seconds, default=5.0, metavar="S", help="length of the chaos (default: 5)")
    parser.add_argument("--kill", action="append", default=[], metavar="pe:NAME@S", help="kill a PE then")
    parser.add_argument("--restore", action="append", default=[], metavar="pe:NAME@S", help="start it again then")
    parser.add_argument("--loss", type=share, default=0.0, metavar="P", help="share of frames that are destroyed")
    parser.add_argument("--json", action="store_true", help="one JSON object a run")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly every seed; returns the exit code."""
    from heronry_tools.simulator.scenario import play  # noqa: PLC0415 - the solver is slow to import
    from heronry_tools.spec_argument import load_spec  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    _check_images(spec)
    worst = 0
    for scenario in _scenarios(spec, arguments):
        outcome = play(spec, scenario)
        lines = [json.dumps(_document(arguments, outcome))] if arguments.json else _lines(arguments, outcome)
        print("\n".join(lines), flush=True)
        worst = max(worst, 1 if outcome.violations else 0)
    return worst


def _scenarios(spec: "Spec", arguments: argparse.Namespace) -> Iterator["Scenario"]:
    from heronry_tools.demo.script import read_script  # noqa: PLC0415
    from heronry_tools.simulator.scenario import Scenario, drawn_acts  # noqa: PLC0415

    given = tuple(read_script(spec, arguments.kill, arguments.restore))
    for seed in range(arguments.seed, arguments.seed + arguments.runs):
        acts = given or drawn_acts(spec, seed, arguments.seconds)
        yield Scenario(seed, max((arguments.seconds, *(act.at_s for act in acts))), acts, arguments.loss)


def _check_images(spec: "Spec") -> None:
    from heronry_agent.images import UnknownImageError, find_image  # noqa: PLC0415

    for module in spec.modules.values():
        try:
            find_image(module.image)
        except UnknownImageError as error:
            raise UserError(f"module {module.name} cannot be simulated: {error}") from None


def _lines(arguments: argparse.Namespace, outcome: "Outcome") -> list[str]:
    scenario = outcome.scenario
    acts = ", ".join(f"{act.what} {act.pe} at {act.at_s:g} s" for act in scenario.acts)
    end = f"{outcome.virtual_ns / 1e9:.1f} s, {outcome.frames} frames, digest {outcome.digest}"
    lines = [f"seed {scenario.seed}: {acts or 'nothing is done'} ({end})"]
    for told in outcome.reconfigurations:
        times = "  ".join(f"{name} {ns / 1e6:6.1f}" for name, ns in told["times_ns"].items())
        cause = told["causes"][-1] if told["causes"] else ""
        lines.append(f"  {told['t_ns'] / 1e9:8.3f} s  epoch {told['epoch']:<4} {times} ms  {cause}")
    if outcome.violations:
        lines += [f"  VIOLATION {violation}" for violation in outcome.violations]
        lines.append(f"  replay with: {_replay(arguments, scenario)}")
    return lines


def _document(arguments: argparse.Namespace, outcome: "Outcome") -> dict[str, Any]:
    return {
        "seed": outcome.scenario.seed,
        "acts": [{"at_s": act.at_s, "what": act.what, "pe": act.pe} for act in outcome.scenario.acts],
        "virtual_ns": outcome.virtual_ns,
        "frames": outcome.frames,
        "digest": outcome.digest,
        "reconfigurations": [
            {key: told[key] for key in ("t_ns", "epoch", "causes", "times_ns")} for told in outcome.reconfigurations
        ],
        "violations": [{"t_ns": v.t_ns, "rule": v.rule, "story": v.story} for v in outcome.violations],
        "replay": _replay(arguments, outcome.scenario),
    }


def _replay(arguments: argparse.Namespace, scenario: "Scenario") -> str:
    words = ["heronry", "sim", arguments.spec, "--seed", str(scenario.seed), "--seconds", f"{arguments.seconds:g}"]
    for option, texts in (("--kill", arguments.kill), ("--restore", arguments.restore)):
        words += [word for text in texts for word in (option, text)]
    return " ".join(words + (["--loss", f"{scenario.loss:g}"] if scenario.loss else []))


def whole_number(text: str) -> int:
    """Read a count; argparse tells the name of this function to the user."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative; write 0 or more")
    return number


def seconds(text: str) -> float:
    """Read a duration."""
    duration = float(text)
    if not 0 <= duration <= 86_400:
        raise argparse.ArgumentTypeError(f"{text} is no time to fly; write 0 to 86400 seconds")
    return duration


def share(text: str) -> float:
    """Read a probability."""
    probability = float(text)
    if not 0 <= probability <= 0.5:
        raise argparse.ArgumentTypeError(f"{text} is no share that a bus survives; write 0 to 0.5")
    return probability
