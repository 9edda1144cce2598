"""Whether new code has run for long enough to be kept, or has failed.

    running     the time in which modules of the code answered their steps adds up. From one answer to the next at most
                GAP_NS count, so that code which does not run is not confirmed by waiting
    passed      that time has reached TRIAL_NS
    failed      a module of the code was not imported or built, raised an exception, or hung; or its partition ended

Only modules whose code comes from the bundle are looked at (`modules`). An answer that is late or stale counts like any
other: it was computed by the code.
"""

from collections.abc import Collection
from enum import Enum, auto

from heronry_agent.core.vocabulary import (
    Action,
    EndPartition,
    Event,
    ImagesMissing,
    PartitionEnded,
    StartFailed,
    StepFailed,
    Stepped,
)

TRIAL_NS = 60_000_000_000
GAP_NS = 2_000_000_000


class Verdict(Enum):
    """What is known of the code so far."""

    RUNNING = auto()
    PASSED = auto()
    FAILED = auto()


class Trial:
    """The trial of the active code; `verdict` is final once it is not RUNNING any more."""

    def __init__(self, modules: Collection[int], images: Collection[str], partitions: Collection[str]) -> None:
        """Begin: nothing has run yet.

        modules, images, partitions: what comes from the bundle: indices of modules, their images and their partitions.
        """
        self._modules, self._images, self._partitions = frozenset(modules), frozenset(images), frozenset(partitions)
        self._ran_ns, self._last_ns = 0, 0
        self.verdict = Verdict.RUNNING
        self.why = ""

    def heard(self, event: Event, now_ns: int) -> None:
        """Take an event that a module host gives to the core."""
        match event:
            case Stepped(module) if module in self._modules:
                self._ran_ns += min(now_ns - self._last_ns, GAP_NS)
                self._last_ns = now_ns
                if self._ran_ns >= TRIAL_NS + GAP_NS and self.verdict is Verdict.RUNNING:  # the first gap was no run
                    self.verdict = Verdict.PASSED
            case StepFailed(module, _, reason) | StartFailed(module, reason) if module in self._modules:
                self._failed(reason)
            case PartitionEnded(partition, reason) if partition in self._partitions:
                self._failed(f"its partition ended: {reason}")
            case ImagesMissing(images) if not self._images.isdisjoint(images):
                self._failed(next(reason for image, reason in sorted(images.items()) if image in self._images))
            case _:
                pass

    def ordered(self, action: Action) -> None:
        """Take an action of the core: it ends the partition of a module that hangs."""
        if isinstance(action, EndPartition) and action.partition in self._partitions:
            self._failed("it hangs")

    def _failed(self, why: str) -> None:
        if self.verdict is Verdict.RUNNING:
            self.verdict, self.why = Verdict.FAILED, why
