"""`heronry replay`: runs the manager's core again on a recorded bus, and compares its decisions with the recorded ones.

Exit codes: 0 all as recorded; 1 something differs; 2 the input cannot be used.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.console.contingencies_argument import Ahead
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.recording.another_spec import of_another_spec
from heronry_tools.recording.masterships import masterships, on_the_managers_bus, read_recording
from heronry_tools.recording.proven import is_tagged, proven
from heronry_tools.recording.recorded_folder import is_recorded_folder, spec_of
from heronry_tools.sim.replay.comparison import Compared, Comparison, compared
from heronry_tools.sim.replay.flown_heartbeat import as_flown, period_ns
from heronry_tools.sim.replay.rerun import Planners, Remark, Rerun
from heronry_tools.sim.world.planning import prepared_with
from heronry_wire.frame import LoggedFrame
from heronry_wire.key_file import read_key


def run(arguments: argparse.Namespace) -> int:
    """Replay every mastership of the recording; returns the exit code."""
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
    with Working(f"replaying {arguments.recording}"):
        for mastership in found:
            rerun = Rerun(planners, mastership)
            rerun.run()
            comparisons.append(compared(mastership, rerun))
    if arguments.json:
        print(json.dumps(_document(spec, no_frames, comparisons), indent=2))
    else:
        _print(comparisons, no_frames, _stretched(own, spec))
    return 1 if any(comparison.differences() for comparison in comparisons) else 0


def _spec_of(recording: Path, text: str | None) -> Spec:
    """Return the spec of the flight: the one that `text` names, or if `text` is None, the one in the recorded folder.

    Raises UserError if a recorded folder is of another spec than `text`, if a log file is given without a spec,
    or if `recording` is itself a spec.
    """
    if is_recorded_folder(recording):
        return spec_of(recording, text)
    if recording.name.endswith((".yaml", ".yml")):
        raise UserError(f"{recording} is a spec, not a recording: write 'heronry replay FILE.log SPEC'")
    if text is None:
        raise UserError(f"{recording} does not name its spec: write SPEC after the file")
    return load_spec(text)


def _as_proven(spec: Spec, frames: list[LoggedFrame], arguments: argparse.Namespace) -> list[LoggedFrame]:
    """Return the frames that the key proves; in a flight without a key, all frames.

    Raises UserError if the flight has a key and --key is missing, or if --key is given and the flight has no key.
    """
    if not is_tagged(frames):
        if arguments.key is not None:
            raise UserError(f"{arguments.recording} is of a flight without a key: leave --key out")
        return frames
    if arguments.key is None:
        raise UserError(f"{arguments.recording} is of a flight with a key: name the key file with --key")
    return proven(spec, read_key(arguments.key), frames)


def _stretched(own: Spec, flown: Spec) -> str | None:
    """Return a sentence for the user if a flight had a longer heartbeat period than its spec states; else None.

    own: the spec. flown: the spec with the heartbeat period of the flight; the same object if the periods are equal.
    """
    if flown is own:
        return None
    flown_ms, own_ms = period_ns(flown) / 1e6, period_ns(own) / 1e6
    return f"flown with a heartbeat of {flown_ms:g} ms, and not {own_ms:g} ms as in the spec: the replay does so too"


def _print(comparisons: list[Comparison], no_frames: int, stretched: str | None) -> None:
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


def _decision(one: Compared) -> str:
    how = {"both": f"as recorded, {one.late_ns / 1e6:+.1f} ms", "recorded": "NOT REPLAYED", "replayed": "NOT RECORDED"}
    return f"  {one.decision!s:32} {how[one.taken]}"


def _remark(one: Remark) -> str:
    return f"DIFFERS: {one.text}" if one.differs else one.text


def _verdict(comparison: Comparison) -> str:
    decisions, differences = comparison.decisions(), comparison.differences()
    if not decisions and not differences:
        return "the manager decided nothing, so there is nothing to compare"
    return f"{decisions} decisions, {'all as recorded' if not differences else f'{differences} differences'}"


def _document(spec: Spec, no_frames: int, comparisons: list[Comparison]) -> dict[str, Any]:
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


def _entry(entry: Compared | Remark) -> dict[str, Any]:
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
