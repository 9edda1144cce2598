"""Code that comes over the bus: a PE runs a whole bundle or none, and no module computes where its code is not.

Verified against what a PE's loader says that it runs from, its disk, and the steps of modules:

- What a PE runs from is, byte for byte, a bundle that the managers were given.
- No module computes a step on a PE that lacks its code.
- A manager says that code has come only when the disk of the PE has it, whole and active.

That transfers leave the bus to the data is verified by the oracle `tables` for all of SDO.
"""

from collections.abc import Collection

from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.steps_seen import Driven


class CodeCheck(Oracle):
    """Verifies what PEs run from, and where modules compute."""

    def __init__(self, bundles: Collection[bytes]) -> None:
        """Know the bundles of the managers, as bytes."""
        super().__init__()
        self._bundles = frozenset(bundles)
        self._lacking: dict[tuple[str, str], int] = {}

    def lacks(self, t_ns: int, pe: str, module: str) -> None:
        """Note that a PE lacks the code of a module from now on."""
        self._lacking[pe, module] = t_ns

    def came(self, t_ns: int, pe: str, content: bytes) -> None:
        """Verify what a PE runs from now on; it lacks no code any more."""
        if content not in self._bundles:
            self.violations.append(Violation(t_ns, "code", f"{pe} runs code that is no whole bundle of the managers"))
        for place in [place for place in self._lacking if place[0] == pe]:
            del self._lacking[place]

    def brought(self, t_ns: int, pe: str, content: bytes | None) -> bool:
        """Verify that code which has come, as a manager says, is what the disk of the PE has; tells whether it is."""
        is_there = content in self._bundles
        if not is_there:
            story = f"a manager says that code has come to {pe}, whose disk has no whole bundle in use"
            self.violations.append(Violation(t_ns, "code", story))
        return is_there

    def driven(self, driven: Driven) -> None:
        """Verify where a module computes that drives an actuator or is a branch of a DEMUX."""
        self._computed(driven)

    def looked(self, stepped: Driven) -> None:
        """Verify where another module computes."""
        self._computed(stepped)

    def _computed(self, step: Driven) -> None:
        since_ns = self._lacking.get((step.pe, step.module))
        if since_ns is not None and step.asked_ns > since_ns:
            story = f"{step.module} computes on {step.pe}, which lacks its code"
            self.violations.append(Violation(step.t_ns, "code", story))
