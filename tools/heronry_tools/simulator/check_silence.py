"""The silence of a manager stops nobody: where nothing but managers failed, every function is heard all the time.

What is not judged: a run in which anything else was struck too.
"""

from collections.abc import Sequence

from heronry_tools.simulator.act import MANAGERS, Act
from heronry_tools.simulator.violation import Violation
from heronry_tools.witness import Outage


def stopped_by_silence(acts: Sequence[Act], outages: Sequence[Outage], since_ns: int) -> list[Violation]:
    """Give the outages since a time in a run whose acts strike managers alone."""
    if any(act.target not in MANAGERS for act in acts):
        return []
    story = "was not heard, and nothing but a manager had failed"
    return [Violation(o.from_ns, "silence", f"{o.function} {story}") for o in outages if o.from_ns >= since_ns]
