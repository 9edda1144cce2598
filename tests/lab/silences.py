"""The longest time for which a function was silent, from the frames on the managers' bus."""

from collections.abc import Collection

from heronry_dg.model import Spec
from heronry_tools.runtime.witness import Witness
from heronry_wire.frame import Frame


class Silences:
    """Measures the time between two outputs of each function that has been heard."""

    def __init__(self, spec: Spec) -> None:
        self._witness = Witness(spec)
        self._functions = {m: [f.name for f in spec.functions.values() if m in f.outputs] for m in spec.modules}
        self._last_ns: dict[str, int] = {}
        self._longest_ns = 0
        self.node: int | None = None  # the one that gave an output last

    @property
    def heard(self) -> Collection[str]:
        """Return the functions that have been heard."""
        return self._last_ns.keys()

    def see(self, at_ns: int, frame: Frame) -> None:
        """Take a frame that ended at this time."""
        output = self._witness.see(at_ns, frame)
        self.node = self.node if output is None else output.node
        for function in () if output is None else self._functions[output.module]:
            self._longest_ns = max(self._longest_ns, at_ns - self._last_ns.get(function, at_ns))
            self._last_ns[function] = at_ns

    def begin(self) -> None:
        """Measure anew from now on; a silence that lasts counts from the last output before."""
        self._longest_ns = 0

    def longest_ns(self, now_ns: int) -> int:
        """Return the longest silence since `begin`, also one that has not ended."""
        return max([self._longest_ns, *(now_ns - last_ns for last_ns in self._last_ns.values())])
