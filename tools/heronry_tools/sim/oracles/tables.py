"""A node without a table gets the whole table of its PE or none, and a PE that flies is asked to take none.

Verified against frames, and against what a node says that it has taken:

- A node that has taken a table has exactly the one that was compiled for its PE.
- What has come of a table is not thrown away: while a node lives and has bytes of one transfer, no other one begins.
- Nobody requests to write the table of a PE (a block download to object 2020h or 2026h) that has shown within the last
  `QUIET_NS`, by a state on the managers' bus, that it follows an epoch; except while a reload brings tables that wait
  beside those that fly.
- SDO takes no more than a share of `MOST_SHARE` of the managers' bus in any `_WINDOW_NS`, so that what flies meets its
  deadlines.

Not verified: requests of a diagnostic client, which may read a table, but writes none by blocks.
"""

from collections.abc import Sequence

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.frame import Malformed
from heronry_wire.part_transfer import Received
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeState, decode_state
from heronry_wire.timing import worst_bits

QUIET_NS = 900_000_000  # the clocks of PE and manager differ, and a state may come late
MOST_SHARE = 0.21
_WINDOW_NS = 100_000_000
_REQUEST, _ANSWER = 1536, 1408  # plus the node-ID (CiA 301)
_NOTHING = Received(bytes(32), 0)  # of a node at its start
_BLOCK_DOWNLOADS_OF_TABLE = ((0xC6, 0x20, 0x20, 0x00), (0xC6, 0x26, 0x20, 0x01))


class TableCheck(Oracle):
    """Verifies what is written into nodes without a table."""

    def __init__(self, spec: Spec, flown: Sequence[FlownSpec]) -> None:
        """Begin with no node that waits; flown: the specs whose tables may be brought."""
        super().__init__()
        self._flown, self._bus = flown, spec.manager.bus
        self._may_write = False  # into a PE that flies
        self._pe_of = {_REQUEST + pe.node_id: pe.name for pe in spec.pes.values()}
        self._sdo = {*self._pe_of, *(_ANSWER + pe.node_id for pe in spec.pes.values())}
        self._names = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._most_bits = MOST_SHARE * spec.buses[self._bus].bitrate * _WINDOW_NS / 1e9
        self._flew_ns: dict[str, int] = {}
        self._received: dict[str, Received] = {}
        self._window, self._bits = 0, 0
        self._worst = [worst_bits(size) for size in range(9)]

    def reload_ordered(self, *, is_over: bool = False) -> None:
        """Note that tables may be written beside those that fly from now on; `is_over`: not any more."""
        self._may_write = not is_over

    def take_over(self, before: "TableCheck") -> None:
        """Take over what the oracle of another spec knows of the nodes."""
        self._flew_ns, self._received = before._flew_ns, before._received
        self._window, self._bits = before._window, before._bits

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """Note that a PE follows an epoch."""
        page = decode_state(data)
        if not isinstance(page, Malformed) and page.state is not PeState.UNCONFIGURED:
            self._flew_ns[self._names[node]] = t_ns

    def seen(self, sent: Sent) -> None:
        """Verify a request to write a table, and add up the bits of SDO."""
        if sent.bus != self._bus or sent.frame.can_id not in self._sdo:
            return
        window = sent.end_ns // _WINDOW_NS
        if window != self._window:
            self._window, self._bits = window, 0
        before, self._bits = self._bits, self._bits + self._worst[len(sent.frame.data)]
        if before <= self._most_bits < self._bits:
            story = f"SDO takes more than {MOST_SHARE:.0%} of {sent.bus}"
            self.violations.append(Violation(sent.end_ns, "table", story))
        pe = self._pe_of.get(sent.frame.can_id)
        if pe is not None and tuple(sent.frame.data[:4]) in _BLOCK_DOWNLOADS_OF_TABLE:
            quiet_ns = sent.end_ns - self._flew_ns.get(pe, -QUIET_NS)
            if quiet_ns < QUIET_NS and not self._may_write:
                story = f"{sent.sender} writes the table of {pe}, which flew {quiet_ns} ns before"
                self.violations.append(Violation(sent.end_ns, "table", story))

    def came(self, t_ns: int, pe: str, received: Received) -> None:
        """Verify that a node which lives goes on with the transfer of which it has bytes."""
        before = self._received.get(pe, _NOTHING)
        self._received[pe] = received
        if before.length and received.digest not in (before.digest, _NOTHING.digest):
            story = f"{pe} has {before.length} bytes of a table, and is sent another one from its beginning"
            self.violations.append(Violation(t_ns, "table", story))

    def took(self, t_ns: int, pe: str, table: PeTable) -> None:
        """Verify the table that a node has taken."""
        if table.to_json() not in [flown.texts.get(pe) for flown in self._flown]:
            self.violations.append(
                Violation(t_ns, "table", f"{pe} has taken a table that is not its own, or not whole")
            )
