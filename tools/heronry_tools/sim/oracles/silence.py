"""A silent manager stops no function: if only managers have failed, every function is heard all the time.

With `without_manager: safe_mode` this is promised only for critical functions.

A function counts as silent from its last output on. The fault that silenced it was injected between that output and the
moment at which the next one was due.

Not verified: a run in which a fault was injected into anything but managers.
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
    """Return a violation for each function that was silent though nothing but managers has failed.

    It looks at the time from `since_ns` to `now_ns`. If any of `targets`, into which faults were injected, is no
    manager, nothing is returned. witness: has the silences of all functions.
    """
    if any(target not in MANAGERS for target in targets):
        return []
    story = "was not heard, though only managers had failed"
    keeps = spec.manager.without_manager == "keep"
    promised = {function for function in spec.functions if keeps or is_critical(spec, function)}
    silent = [o for o in witness.outages(now_ns) if o.function in promised and o.from_ns >= since_ns]
    return [
        Violation(o.from_ns + witness.patience_ns(o.function), "silence", f"{o.function} {story}", o.from_ns)
        for o in silent
    ]
