"""The silence of a manager stops no function: where nothing but managers failed, every function is heard all the time.

With `without_manager: safe_mode` that is promised for critical functions alone.

The fault that silenced a function was injected at some time between its last output and the moment at which the next
one was due.

Not verified: a run in which a fault was injected into anything else, too.
"""

from collections.abc import Iterable

from heronry_dg.model import Spec
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.faults.fault import MANAGERS
from heronry_tools.sim.oracles.safe_mode import is_critical
from heronry_tools.sim.oracles.violation import Violation


def stopped_by_silence(
    spec: Spec, targets: Iterable[str], witness: Witness, since_ns: int, now_ns: int
) -> list[Violation]:
    """Give the outages from a time up to now in a run in which nothing was done to anything but managers."""
    if any(target not in MANAGERS for target in targets):
        return []
    story = "was not heard, and nothing but a manager had failed"
    keeps = spec.manager.without_manager == "keep"
    promised = {function for function in spec.functions if keeps or is_critical(spec, function)}
    silent = [o for o in witness.outages(now_ns) if o.function in promised and o.from_ns >= since_ns]
    return [
        Violation(o.from_ns + witness.patience_ns(o.function), "silence", f"{o.function} {story}", o.from_ns)
        for o in silent
    ]
