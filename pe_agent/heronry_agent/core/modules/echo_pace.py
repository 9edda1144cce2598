"""How often each output of this PE is echoed: as often as the table says (protocol rule 14).

The first echo of an output goes out at once. Further echoes follow a grid of the period that the table gives. If an
output has nothing to echo for a period, the grid begins anew. So in any time T an output has at most T / period + 1
echoes, whatever the rate of its module.

A simulated plant that follows actuators of other PEs needs every command. If it asks for that, nothing is left out.
"""

from heronry_agent.core.carried_over import CarriedOver
from heronry_wire.pe_table import PeTable

_NS_PER_S = 1_000_000_000


class EchoPace:
    """Tells for each step or command whether its echo is due."""

    def __init__(self, table: PeTable, *, every_echo: bool = False) -> None:
        """Begin with no output echoed; every_echo: every echo is due."""
        self.every = every_echo
        self._period_ns = _NS_PER_S // table.echoes_per_s
        self._due_ns: dict[int, int] = {}  # by module

    def carry_over(self, table: PeTable, carried: CarriedOver) -> None:
        """Go on with the pace of another table."""
        self._period_ns = _NS_PER_S // table.echoes_per_s
        self._due_ns = carried.by_module(self._due_ns)

    def is_due(self, module: int, now_ns: int) -> bool:
        """Tell whether the output of a module is to be echoed now; the answer True counts as an echo."""
        due_ns = self._due_ns.get(module, now_ns)
        if now_ns < due_ns and not self.every:
            return False
        follows = now_ns < due_ns + self._period_ns
        self._due_ns[module] = (due_ns if follows else now_ns) + self._period_ns
        return True
