"""The silence of a manager stops nobody: where nothing but managers failed, every function is heard all the time.

With `without_manager: safe_mode` that is promised to what is critical alone.

What is not judged: a run in which anything else was struck too.
"""

from collections.abc import Iterable, Sequence

from heronry_dg.model import Spec
from heronry_tools.simulator.act import MANAGERS
from heronry_tools.simulator.check_safe_mode import is_critical
from heronry_tools.simulator.violation import Violation
from heronry_tools.witness import Outage


def stopped_by_silence(spec: Spec, targets: Iterable[str], outages: Sequence[Outage], since_ns: int) -> list[Violation]:
    """Give the outages since a time in a run in which nothing was done to anybody but managers."""
    if any(target not in MANAGERS for target in targets):
        return []
    story = "was not heard, and nothing but a manager had failed"
    keeps = spec.manager.without_manager == "keep"
    promised = {function for function in spec.functions if keeps or is_critical(spec, function)}
    silent = [outage for outage in outages if outage.function in promised and outage.from_ns >= since_ns]
    return [Violation(outage.from_ns, "silence", f"{outage.function} {story}") for outage in silent]
