"""An explanation as plain data: what `heronry why --json` prints."""

from typing import Any

from heronry_dg.model import Spec
from heronry_tools.analysis.why.assumptions import capacity, in_words
from heronry_tools.analysis.why.reasons import Explanation


def document(spec: Spec, found: Explanation) -> dict[str, Any]:
    """Return the explanation as plain data."""
    return {
        "spec": spec.name,
        "digest": spec.digest,
        "function": found.function.name,
        "phase": found.now.phase,
        "down": sorted(found.now.down),
        "limits": {element: f"{float(100 * share):g}%" for element, share in sorted(found.now.limits.items())},
        "served": found.report.served,
        "mode": found.report.mode,
        "value": found.report.value,
        "best_value": found.best_value,
        "why_not": found.report.why_not,
        "shortfalls": list(found.shortfalls),
        "reasons": [{"kind": one.kind, "name": one.name, "text": in_words(spec, one)} for one in found.reasons],
        "logical": [sorted(down) for down in found.logical],
        "repairs": [
            {
                "restore": list(repair.restore),
                **({"whole": list(repair.whole)} if repair.whole else {}),
                "add": [
                    {"kind": one.kind, "name": one.name, "more": amount - capacity(spec, one)}
                    for one, amount in repair.capacities
                ],
            }
            for repair in found.repairs
        ],
    }
