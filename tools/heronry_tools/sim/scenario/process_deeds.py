"""The deeds of a script that can be done to real processes, each as one or two steps.

    one step     an order of the operator; a kill; a restore; a fault without an end
    two steps    a fault with an end: a crash is a kill and a restore, a pause is a SIGSTOP and a SIGCONT

Only crashes and pauses can be injected, of PEs and of managers. A fault that waits for a state of the protocol cannot
be injected, since this program learns of the state too late.
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
    """One step of a deed: kill, restore, stop, go_on, phase, priority, fail, clear, script or release."""

    at_ns: int
    what: str
    deed: Deed
    is_last: bool = False  # it ends the fault that the first step of its deed has begun

    @property
    def target(self) -> str:
        """Return the target of this step's deed, for example an element or a manager."""
        return self.deed.target


def can_be_done(deed: Deed) -> bool:
    """Tell whether a flight of real processes can carry out a deed."""
    if deed.fault is None:
        return deed.what in ("kill", "restore", "wait", *ORDERS)
    return deed.fault.kind in _FAULTS and not deed.fault.during


def steps(deeds: Iterable[Deed]) -> list[Step]:
    """Return, in order of time, the steps of those deeds that a flight of real processes can carry out."""
    found = [step for deed in deeds if can_be_done(deed) for step in _steps_of(deed)]
    return sorted(found, key=lambda step: step.at_ns)


def _steps_of(deed: Deed) -> Iterator[Step]:
    if deed.what == "wait":
        return
    if deed.fault is None:
        yield Step(deed.at_ns, deed.what, deed)
        return
    begins, ends = _FAULTS[deed.fault.kind]
    yield Step(deed.at_ns, begins, deed)
    if deed.fault.lasts_ms:
        yield Step(deed.at_ns + deed.fault.lasts_ms * _NS_PER_MS, ends, deed, is_last=True)
