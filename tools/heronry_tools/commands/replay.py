"""`heronry replay`: runs the manager's core again on a recorded bus, and compares its decisions with the recorded ones.

Exit codes: 0 all as recorded; 1 something differs; 2 the input cannot be used.
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.analysis.made_ahead import Ahead, add_contingencies_argument, contingencies_of
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import SHIPPED

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.sim.replay.comparison import Compared, Comparison
    from heronry_tools.sim.replay.rerun import Remark
    from heronry_wire.frame import LoggedFrame

_EPILOG = """\
Each PREPARE and each step of ACTIVATE that the manager sent is a decision. The manager's core gets the frames that the
manager heard, at the same times. The replay shows what led to each decision, and whether the decision is the recorded
one. The channels of the log name its buses, as in a log of 'heronry demo --record'.

The operator's orders are not on the bus, so they are not replayed. SPEC must be the spec with which the manager flew,
and the recording must begin before the manager starts.

Exit codes: 0 all as recorded; 1 something differs; 2 the input cannot be used.

examples:
  heronry demo big_blue --kill pe:nav@3 --for 8 --record flight.log
  heronry replay flight.log big_blue
  heronry replay FOLDER                          a folder of 'heronry record' has its spec
  heronry replay flight.log big_blue --json | jq '.masterships[].entries[] | select(.differs)'
  heronry replay can0.log my.dg.yaml --contingencies my.contingencies
  heronry replay can0.log my.dg.yaml --key fleet.key
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry replay`."""
    parser = subparsers.add_parser(
        "replay",
        description="Run a recorded bus through the manager's core again, explain its decisions, and compare them.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "recording", metavar="FILE.log", type=Path, help="a candump log, or a folder of 'heronry record'"
    )
    parser.add_argument(
        "spec",
        metavar="SPEC",
        nargs="?",
        help=f"a *.dg.yaml file, or a shipped spec: {', '.join(SHIPPED)} (default: the spec in the folder)",
    )
    parser.add_argument(
        "--channel",
        metavar="NAME",
        help="CAN interface of the manager's bus, as the log names it; A,B if that bus has two channels",
    )
    single = "the plans for every single fault, if a PREPARE names a contingency by its number"
    add_contingencies_argument(parser, "with which the manager flew", single)
    parser.add_argument("--key", type=Path, metavar="FILE", help="key file with which the manager flew")
    add_output(parser, "write everything as JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Replay every mastership of the recording; returns the exit code."""
    from heronry_tools.console.errors import UserError  # noqa: PLC0415 - with all below slow to import, and no help to `--help`
    from heronry_tools.recording.another_spec import of_another_spec  # noqa: PLC0415
    from heronry_tools.recording.masterships import masterships, on_the_managers_bus, read_recording  # noqa: PLC0415
    from heronry_tools.sim.replay.comparison import compared  # noqa: PLC0415
    from heronry_tools.sim.replay.flown_heartbeat import as_flown  # noqa: PLC0415
    from heronry_tools.sim.replay.rerun import Planners, Rerun  # noqa: PLC0415
    from heronry_tools.sim.world.planning import prepared_with  # noqa: PLC0415

    own = _spec_of(arguments.recording, arguments.spec)
    frames, no_frames = read_recording(arguments.recording)
    on_the_bus = _as_proven(own, on_the_managers_bus(own, frames, arguments.channel), arguments)
    spec = as_flown(own, masterships(own, on_the_bus))
    found = masterships(spec, on_the_bus)
    if not found:
        proof, remedy = "", "record all frames of the manager's bus, or name this bus with --channel"
        if arguments.key is not None:
            proof, remedy = f" that {arguments.key} proves", "name the key file with which the manager flew"
        raise UserError(f"no manager is active in {arguments.recording}: the recording has no LEASE{proof}; {remedy}")
    if found[0].epoch:
        raise UserError(
            f"{arguments.recording} begins in the middle of a mastership, at epoch {found[0].epoch} of term "
            f"{found[0].term}: record from before the manager starts"
        )
    is_silent = arguments.contingencies is Ahead.SINGLE_FAULTS and not any(
        mastership.calls_by_number() for mastership in found
    )
    made = None if is_silent else contingencies_of(spec, arguments.contingencies)
    planners = Planners(spec, prepared_with(spec, made))
    for mastership in found:
        why = of_another_spec(spec, mastership, planners.ahead.tables.values())
        if why is not None:
            raise UserError(f"{arguments.recording}: {why}")
    comparisons = []
    for mastership in found:
        rerun = Rerun(planners, mastership)
        rerun.run()
        comparisons.append(compared(mastership, rerun))
    if arguments.json:
        print(json.dumps(_document(spec, no_frames, comparisons), indent=2))
    else:
        _print(comparisons, no_frames, _stretched(own, spec))
    return 1 if any(comparison.differences() for comparison in comparisons) else 0


def _spec_of(recording: Path, text: str | None) -> "Spec":
    """Give the spec of the flight: the one that `text` names, or if `text` is None, the one in the recorded folder.

    Raises UserError if a recorded folder is of another spec than `text`, if a log file is given without a spec,
    or if `recording` is itself a spec.
    """
    from heronry_tools.console.errors import UserError  # noqa: PLC0415
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.recording.recorded_folder import is_recorded_folder, spec_of  # noqa: PLC0415

    if is_recorded_folder(recording):
        return spec_of(recording, text)
    if recording.name.endswith((".yaml", ".yml")):
        raise UserError(f"{recording} is a spec, not a recording: write 'heronry replay FILE.log SPEC'")
    if text is None:
        raise UserError(f"{recording} does not name its spec: write SPEC after the file")
    return load_spec(text)


def _as_proven(spec: "Spec", frames: "list[LoggedFrame]", arguments: argparse.Namespace) -> "list[LoggedFrame]":
    """Give the frames that the key proves; in a flight without a key, all frames.

    Raises UserError if the flight has a key and --key is missing, or if --key is given and the flight has no key.
    """
    from heronry_tools.console.errors import UserError  # noqa: PLC0415
    from heronry_tools.recording.proven import is_tagged, proven  # noqa: PLC0415
    from heronry_wire.key_file import read_key  # noqa: PLC0415

    if not is_tagged(frames):
        if arguments.key is not None:
            raise UserError(f"{arguments.recording} is of a flight without a key: leave --key out")
        return frames
    if arguments.key is None:
        raise UserError(f"{arguments.recording} is of a flight with a key: name the key file with --key")
    return proven(spec, read_key(arguments.key), frames)


def _stretched(own: "Spec", flown: "Spec") -> str | None:
    """Give a sentence for the user if a flight had a longer heartbeat period than its spec states; else None.

    own: the spec. flown: the spec with the heartbeat period of the flight; the same object if the periods are equal.
    """
    from heronry_tools.sim.replay.flown_heartbeat import period_ns  # noqa: PLC0415

    if flown is own:
        return None
    flown_ms, own_ms = period_ns(flown) / 1e6, period_ns(own) / 1e6
    return f"flown with a heartbeat of {flown_ms:g} ms, and not {own_ms:g} ms as in the spec: the replay does so too"


def _print(comparisons: "list[Comparison]", no_frames: int, stretched: str | None) -> None:
    from heronry_tools.sim.replay.comparison import Compared  # noqa: PLC0415

    if no_frames:
        print(f"lines of the recording without a frame: {no_frames}\n")
    if stretched is not None:
        print(f"{stretched}\n")
    for comparison in comparisons:
        mastership = comparison.mastership
        print(f"manager {mastership.node}, term {mastership.term}: {len(mastership.heard)} frames heard")
        for entry in comparison.entries:
            text = _decision(entry) if isinstance(entry, Compared) else _remark(entry)
            print(f"{(entry.t_ns - mastership.first_ns) / 1e9:10.3f} s  {text}")
        print(f"{_verdict(comparison)}\n")


def _decision(one: "Compared") -> str:
    how = {"both": f"as recorded, {one.late_ns / 1e6:+.1f} ms", "recorded": "NOT REPLAYED", "replayed": "NOT RECORDED"}
    return f"  {one.decision!s:32} {how[one.taken]}"


def _remark(one: "Remark") -> str:
    return f"DIFFERS: {one.text}" if one.differs else one.text


def _verdict(comparison: "Comparison") -> str:
    decisions, differences = comparison.decisions(), comparison.differences()
    if not decisions and not differences:
        return "the manager decided nothing, so there is nothing to compare"
    return f"{decisions} decisions, {'all as recorded' if not differences else f'{differences} differences'}"


def _document(spec: "Spec", no_frames: int, comparisons: "list[Comparison]") -> dict[str, Any]:
    from heronry_tools.sim.replay.flown_heartbeat import period_ns  # noqa: PLC0415

    return {
        "spec": spec.name,
        "heartbeat_ns": period_ns(spec),
        "lines_that_are_no_frames": no_frames,
        "masterships": [
            {
                "manager": comparison.mastership.node,
                "term": comparison.mastership.term,
                "decisions": comparison.decisions(),
                "differences": comparison.differences(),
                "entries": [_entry(entry) for entry in comparison.entries],
            }
            for comparison in comparisons
        ],
    }


def _entry(entry: "Compared | Remark") -> dict[str, Any]:
    from heronry_tools.sim.replay.rerun import Remark  # noqa: PLC0415

    if isinstance(entry, Remark):
        return {"t_ns": entry.t_ns, "remark": entry.text, "differs": entry.differs}
    decision = entry.decision
    return {
        "t_ns": entry.t_ns,
        "decision": decision.what,
        "epoch": decision.epoch,
        "digest": f"{decision.digest:06X}",
        "taken": entry.taken,
        "late_ns": entry.late_ns,
        "differs": entry.taken != "both",
    }
