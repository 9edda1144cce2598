"""What is done to real processes, step by step: the orders of a script, kills, and faults that are two steps.

A death that is over after a while is a kill and a restore; a pause is a SIGSTOP and a SIGCONT. A fault that waits for a
state of the protocol cannot be injected: the state is not known here in time.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from heronry_tools.sim.scenario.script import ORDERS, Deed

_FAULTS = {
    "crash": ("kill", "restore"),
    "pause": ("stop", "go_on"),
    "manager_crash": ("kill", "restore"),
    "manager_pause": ("stop", "go_on"),
}
_NS_PER_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that is done: kill, restore, stop, go_on, phase, fail or clear."""

    at_ns: int
    what: str
    deed: Deed
    is_last: bool = False  # it ends what an earlier step of its deed has begun

    @property
    def target(self) -> str:
        """Element or manager that it is done to."""
        return self.deed.target


def can_be_done(deed: Deed) -> bool:
    """Tell whether a deed can be done to processes."""
    if deed.fault is None:
        return deed.what in ("kill", "restore", *ORDERS)
    return deed.fault.kind in _FAULTS and not deed.fault.during


def steps(deeds: Iterable[Deed]) -> list[Step]:
    """Everything that is done to processes, in order; other deeds are left out."""
    found = [step for deed in deeds if can_be_done(deed) for step in _steps_of(deed)]
    return sorted(found, key=lambda step: step.at_ns)


def _steps_of(deed: Deed) -> Iterator[Step]:
    if deed.fault is None:
        yield Step(deed.at_ns, deed.what, deed)
        return
    begins, ends = _FAULTS[deed.fault.kind]
    yield Step(deed.at_ns, begins, deed)
    if deed.fault.lasts_ms:
        yield Step(deed.at_ns + deed.fault.lasts_ms * _NS_PER_MS, ends, deed, is_last=True)
