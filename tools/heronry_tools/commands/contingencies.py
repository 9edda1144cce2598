"""`heronry contingencies`: a plan for every set of faults, made ahead and kept in one file.

Exit codes: 0 the file was written, or every entry of it is correct; 1 an entry is wrong; 2 the input cannot be used.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_manager.contingency.file_format import read_contingencies
from heronry_manager.core.tables import on_board
from heronry_tools.analysis.campaign.checking import faults_of
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.scope import jobs_of, scope_of
from heronry_tools.analysis.campaign.sweeping import Written, sweep_into
from heronry_tools.console.output import expect_ending
from heronry_tools.console.spec_files import load_spec


def run(arguments: argparse.Namespace) -> int:
    """Make a contingency file, or verify one; returns the exit code."""
    spec = load_spec(arguments.spec)
    return _make(spec, arguments) if arguments.check is None else _check(spec, arguments)


def _make(spec: Spec, arguments: argparse.Namespace) -> int:
    expect_ending(arguments.output, {"contingencies": (".contingencies",)})
    scope = scope_of(spec, arguments, places=True)
    with crew(jobs_of(arguments), arguments.scheduler) as executor:
        written = sweep_into(arguments.output, spec, scope, executor)
    if arguments.json:
        print(json.dumps(_document(spec, arguments.output, written), indent=2))
    else:
        _report(spec, arguments.output, written)
    return 0


def _report(spec: Spec, file: Path, written: Written) -> None:
    made, tally, scope = written.made, written.tally, written.made.scope
    total = sum(1 for _ in made.entries())
    unproven = sum(not plan.optimal for _, _, plan in made.entries())
    in_use = " and of the places in use" if scope.places else ""
    phases = f" in {len(made.phases)} phases" if len(made.phases) > 1 else ""
    print(f"{file}: {written.size} bytes, for {spec.name} with digest {spec.digest[:12]}")
    print(
        f"{total} plans for up to {scope.faults} faults of {len(scope.elements)} elements{in_use}{phases}, "
        f"and {len(made.phases)} for safe mode"
    )
    print(
        f"{tally.searched} plans searched for, {tally.pruned_share():.1%} found without a search: "
        f"{tally.by_plan} because the plan for one fault fewer stays the best, "
        f"{tally.by_twin} because another fault has the same effect"
    )
    print(f"{len(made.configurations)} different configurations; {unproven} plans not proven to be the best")
    for one in on_board(spec, made):
        room = f"{len(one.block)} of {one.room} bytes"
        rest = len(made.configurations) - one.held
        where = "" if rest == 0 else f"; only the manager holds the other {rest}"
        print(f"PE {one.pe}: {one.held} configurations on board, {room}{where}")


def _document(spec: Spec, file: Path, written: Written) -> dict[str, Any]:
    made, tally, scope = written.made, written.tally, written.made.scope
    return {
        "file": str(file),
        "bytes": written.size,
        "spec": spec.digest,
        "faults": scope.faults,
        "elements": list(scope.elements),
        "phases": [one.phase for one in made.phases],
        "plans": sum(1 for _ in made.entries()),
        "searched": tally.searched,
        "configurations": len(made.configurations),
        "not_proven": sum(not plan.optimal for _, _, plan in made.entries()),
        "on_board": {
            one.pe: {"configurations": one.held, "bytes": len(one.block), "room": one.room}
            for one in on_board(spec, made)
        },
    }


def _check(spec: Spec, arguments: argparse.Namespace) -> int:
    made = read_contingencies(arguments.check, spec)
    with crew(jobs_of(arguments), arguments.scheduler) as executor:
        wrong = faults_of(spec, made, executor)
    entries = sum(1 for _ in made.entries())
    if arguments.json:
        print(json.dumps({"correct": not wrong, "plans": entries, "wrong": wrong}, indent=2))
        return 1 if wrong else 0
    for sentence in wrong:
        print(sentence)
    if not wrong:
        print(
            f"{entries} plans and {len(made.phases)} for safe mode: all are legal; "
            f"the values of the {entries} plans are as in the file"
        )
    return 1 if wrong else 0
