"""A module starts only from a state that it has saved itself: whole, of the same version of its code, and young enough.

The simulator reports each state that a module has saved, and each state from which a module has started, with the
moment on the simulator's own clock. The oracle reads no frame: whatever became of the state between these two moments,
the following must hold for each start from a state:

- The same module has saved exactly these bytes before, in the round that the state names. So no half of a state is
  restored, and none of another module. Equal bytes of another round are another state, with an age of its own.
- The same version of the code has saved them. Which version a PE has is known to the simulator, and is no digest.
- The time since then, as it really passed, is at most `max_age_ms` of the spec.
- The module is told no shorter time than that.
- No start has used the state before on this PE: a state that makes its module fail is used once.

Where two rounds of one number have equal bytes, the oracle takes the younger one. So it sees most in a module whose
state is never the same again (`Count` in `tests/lab/checkpoints`).
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.steps_seen import StateSeen

_SLACK_NS = 2_000_000  # the PE's clock may run slow


class CheckpointCheck(Oracle):
    """Compares the states from which modules start with those that were saved."""

    def __init__(self, spec: Spec) -> None:
        """Begin without states."""
        super().__init__()
        self._max_age_ns = {
            name: module.checkpoint.max_age_ns for name, module in spec.modules.items() if module.checkpoint is not None
        }
        self._saved: dict[str, list[StateSeen]] = {name: [] for name in self._max_age_ns}
        self._used: set[tuple[str, str, int]] = set()  # module, PE, and when the state was saved

    def state_seen(self, seen: StateSeen) -> None:
        """Record a state that was saved, or verify one that was restored."""
        if seen.is_saved:
            self._saved[seen.module].append(seen)
            return
        equal = [one for one in self._saved[seen.module] if (one.data, one.round) == (seen.data, seen.round)]
        same = [one for one in equal if one.code == seen.code]
        if not equal:
            self._tell(seen, f"from {seen.data.hex()}, which it has never saved")
        elif not same:
            self._tell(seen, "from a state of another version of its code")
        else:
            self._assess(seen, same[-1])

    def _assess(self, seen: StateSeen, saved: StateSeen) -> None:
        age_ns, most_ns = seen.t_ns - saved.t_ns, self._max_age_ns[seen.module]
        key = seen.module, seen.pe, saved.t_ns
        if age_ns > most_ns + _SLACK_NS:
            self._tell(seen, f"from a state that is {age_ns / 1e6:.1f} ms old, but may be {most_ns / 1e6:g} ms old")
        elif seen.age_ns < age_ns - _SLACK_NS:
            told = f"{age_ns / 1e6:.1f} ms old, and is told {seen.age_ns / 1e6:.1f} ms"
            self._tell(seen, f"from a state that is {told}")
        elif key in self._used:
            self._tell(seen, "from a state from which it has started there before")
        self._used.add(key)

    def _tell(self, seen: StateSeen, what: str) -> None:
        self.violations.append(Violation(seen.t_ns, "checkpoint", f"{seen.module} on {seen.pe} starts {what}"))
