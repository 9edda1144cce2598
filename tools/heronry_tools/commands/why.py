"""`heronry why`: why a function is not served, or not as well as it could be, and what would repair it.

Exit codes: 0 with any answer; 2 the input cannot be used.
"""

import argparse
import json
import sys

from heronry_dg.model import Spec
from heronry_tools.analysis.why.assumptions import Assumption, capacity, in_words
from heronry_tools.analysis.why.document import document
from heronry_tools.analysis.why.reasons import Explanation, Repair, explain
from heronry_tools.console.plan_argument import situation_of
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec, named_function


def run(arguments: argparse.Namespace) -> int:
    """Explain how a function is served, or why not; returns the exit code."""
    with Working(f"explaining {arguments.function}"):
        spec = load_spec(arguments.spec)
        function = named_function(spec, arguments.function)
        now = situation_of(spec, arguments)
        found = explain(spec, now, function)
    sys.stdout.write((_json if arguments.json else _text)(spec, found))
    return 0


def _text(spec: Spec, found: Explanation) -> str:
    lines = [_headline(found)]
    if any(found.logical):
        sets = "; or ".join(" and ".join(sorted(down)) for down in found.logical)
        lines.append(f"by the logic of the graph it is lost without: {sets}")
    if found.reasons:
        lines += ["because, all at once:", *(f"  {in_words(spec, one)}" for one in found.reasons)]
    if found.repairs:
        lines += ["repaired by:" if len(found.repairs) == 1 else "repaired by any one of these:"]
        lines += [f"  {_repair(spec, one)}" for one in found.repairs]
    elif found.reasons:
        lines.append("no returning element and no added capacity repairs it")
    if found.shortfalls:
        lines += ["less than the best, in it and upstream of it:", *(f"  {what}" for what in found.shortfalls)]
    return "\n".join(lines) + "\n"


def _headline(found: Explanation) -> str:
    name, report = found.function.name, found.report
    where = f" in {found.now.phase}" if found.now.phase is not None else ""
    if not report.served:
        return f"{name} is not served{where}: {report.why_not}"
    if report.value >= found.best_value:
        but = ", but not with the best upstream" if found.shortfalls else ""
        return f"{name} is served{where}, in its best mode: {report.mode}{but}"
    return (
        f"{name} is served{where}, but only in mode {report.mode}: value {report.value} instead of {found.best_value}"
    )


def _repair(spec: Spec, repair: Repair) -> str:
    parts = [f"{element} comes back" for element in repair.restore]
    parts += [f"{element} has its whole capacity again" for element in repair.whole]
    parts += [_more(spec, one, amount) for one, amount in repair.capacities]
    return ", and ".join(parts)


def _more(spec: Spec, one: Assumption, amount: int) -> str:
    more = amount - capacity(spec, one)
    match one.kind:
        case "cpu":
            return f"{more / 1000:g} cores more on pe {one.name} ({amount / 1000:g} in all)"
        case "bandwidth":
            return f"{more} bit/s more on bus {one.name} ({amount} in all)"
        case kind:
            return f"{more} bytes of {kind.replace('ram', 'RAM')} more on pe {one.name} ({amount} in all)"


def _json(spec: Spec, found: Explanation) -> str:
    return json.dumps(document(spec, found), indent=2, ensure_ascii=False) + "\n"
