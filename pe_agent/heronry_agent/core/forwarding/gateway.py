"""The gateway function of a PE on several buses: which frames it forwards from bus to bus (protocol rule 9).

    down, from the uplink   the commands that this PE accepts. LEASE and ALIVE are forwarded immediately when their
                            content is new, else once in the heartbeat period of the far bus. A SLICE is forwarded only
                            toward the node that it addresses
    up, to the uplink       state, EMCY, emergency events, heartbeat and output echo of the nodes beyond, and the
                            reports about radios from the gateways beyond
    data                    the data of each source that the slice names, from its producing node to the named ports
    SDO                     requests from the uplink toward the node that they address, and the answers of that node for
                            ASKED_NS after a request; so a manager brings nodes beyond their tables, and a client on a
                            far bus loads no other bus. Requests take a tenth of the far bus, with at most MOST_AT_ONCE
                            frames in a row: what comes faster, from a client without manners or forged, is dropped, and
                            the client sends it again

A module that runs beyond this gateway may have another possible PE on the manager's side. Then its data, when this PE
forwards them up, are an exclusive output of this PE (protocol rule 6). The reason: if the manager considers this PE
down, it considers all nodes beyond this PE down, and may have started the module on the other possible PE.

Frames to a radio that leads away from the manager go through `radio_port`, which measures the bandwidth of the radio.

Between two PEs there is at most one route, and no frame is sent back to the bus from which it came. So no frame goes in
circles. On a PE with one bus the gateway forwards nothing.

Special cases:

- A command was not forwarded: the next LEASE, or the manager's retry, repeats it.
- A frame comes late, twice or out of order: it is forwarded as it comes. The receiver of a command, a state or a datum
  recognizes an old one.
- The process has paused: the frames that waited are forwarded immediately, except exclusive ones.
- The PE has restarted: the gateway forwards no data until it has a slice.
- A frame is forged: it is forwarded like a true one.
"""

from collections.abc import Callable, Mapping

from heronry_agent.core.table_index import TableIndex
from heronry_wire.canaerospace import node_of
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    GATEWAY_IDS,
    Command,
    actuator_echo_id,
    emcy_id,
    emergency_event_id,
    heartbeat_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import slice_node
from heronry_wire.protocol_times import slack_ns
from heronry_wire.sansio import Send
from heronry_wire.sdo import MESSAGE_BYTES
from heronry_wire.timing import worst_bits

ASKED_NS = 2_000_000_000  # a client waits no longer for an answer


MOST_AT_ONCE = 16
_SHARE = 10  # of the far bus for requests of SDO: a tenth, as for a transfer (protocol rule 10)


class Gateway:
    """Decides which received frames a PE forwards, and to which ports."""

    def __init__(self, index: TableIndex) -> None:
        self._index = index
        self._uplink = index.uplink
        self._far = [port for port in index.ports if port != index.uplink]
        self._ports = index.table.ports
        self._asked_ns: dict[int, int] = {}  # by node: when a request of SDO was last forwarded to it
        self._each_ns = {
            port: _SHARE * worst_bits(MESSAGE_BYTES) * 1_000_000_000 // self._ports[port].bitrate for port in self._far
        }
        self._free_ns = dict.fromkeys(self._far, 0)  # by far port: when all forwarded requests have had their time
        self._last: dict[
            tuple[int, Command], tuple[bytes, int]
        ] = {}  # by far port and command: what was last sent, and when it is due again
        self._data: dict[int, tuple[int, int]] = {}
        self.contested_ids: frozenset[int] = frozenset()  # identifiers of exclusive data that is forwarded up
        self.look_beyond()

    def look_beyond(self) -> None:
        """Find the nodes beyond, at the start and when another table flies; their buses stay the same."""
        self._ports = self._index.table.ports
        self._beyond = {port: frozenset(self._ports[port].nodes) for port in self._far}
        self._rising = {
            (port, identifier) for port in self._far for identifier in (*_told_up(self._beyond[port]), *GATEWAY_IDS)
        }
        nodes = {node: port for port in self._far for node in self._beyond[port]}
        self.asking_ids: Mapping[int, int] = {sdo_request_id(node): node for node in nodes}
        self._answering = {(port, sdo_response_id(node)): node for node, port in nodes.items()}

    @property
    def rising_ids(self) -> set[int]:
        """CAN identifiers of the reports that are forwarded from a far bus (away from the manager) to the uplink."""
        return {identifier for _, identifier in self._rising}

    @property
    def answering_ids(self) -> set[int]:
        """CAN identifiers of the SDO answers of nodes beyond."""
        return {identifier for _, identifier in self._answering}

    def asked(self, port: int, frame: Frame, now_ns: int) -> list[Send]:
        """Return the copy of an SDO request from the uplink toward the node that it addresses, if it has room."""
        if port != self._uplink:
            return []
        node = self.asking_ids[frame.can_id]
        copies = [copy for copy in self.toward(node, frame) if self._has_room(copy.port, now_ns)]
        if copies:
            self._asked_ns[node] = now_ns
        return copies

    def answered(self, port: int, frame: Frame, now_ns: int) -> list[Send]:
        """Return the copy, for the uplink, of an SDO answer of a node beyond; nothing if nobody asks from there."""
        asked_ns = self._asked_ns.get(self._answering.get((port, frame.can_id), -1))
        return [] if asked_ns is None or now_ns - asked_ns > ASKED_NS else [Send(self._uplink, frame)]

    def rewire(self, forward: Mapping[int, tuple[int, int]]) -> None:
        """Set which data to forward, and to which ports.

        forward: index of a source -> (node that produces its data, bit mask of the ports), as in a slice.
        """
        sources = self._index.table.sources
        self._data = {sources[source].identifier: entry for source, entry in forward.items()}
        up = 1 << self._uplink
        self.contested_ids = frozenset(
            sources[source].identifier
            for source in self._index.contested.intersection(forward)
            if forward[source][1] & up
        )

    def down(self, command: Command, meaning: bytes, frame: Frame, now_ns: int) -> list[Send]:
        """Return the copies of an accepted command for the far buses.

        meaning: the bytes of the command without those that change in every frame.
        """
        if command is Command.SLICE:
            return self.toward(slice_node(frame.data), frame)
        if command not in (Command.LEASE, Command.ALIVE):
            return [Send(port, frame) for port in self._far]
        return [Send(port, frame) for port in self._far if self._is_due(port, command, meaning, now_ns)]

    def toward(self, node: int, frame: Frame) -> list[Send]:
        """Return the copy of a frame for one node on a far bus; nothing if the node is on no far bus."""
        return [Send(port, frame) for port in self._far if node in self._beyond[port]]

    def up(self, port: int, frame: Frame) -> list[Send]:
        """Return the copy, for the uplink, of a report from a node on a far bus; nothing for any other frame."""
        return [Send(self._uplink, frame)] if (port, frame.can_id) in self._rising else []

    def data(self, port: int, frame: Frame, now_ns: int, exclusive_until_ns: Callable[[int], int | None]) -> list[Send]:
        """Return the copies of a data frame that has come in at `port`, for the other ports that the slice names.

        exclusive_until_ns: called with `now_ns` if the frame is exclusive. It returns the time in ns until which the
        frame may leave on the uplink; None: the frame may not leave there.
        """
        entry = self._data.get(frame.can_id)
        if entry is None or node_of(frame.data) != entry[0]:
            return []
        mask = entry[1] & ~(1 << port)
        if frame.can_id not in self.contested_ids:
            return [Send(to, frame) for to in range(len(self._ports)) if mask >> to & 1]
        until_ns, up = exclusive_until_ns(now_ns), 1 << self._uplink
        others = [Send(to, frame) for to in self._far if mask >> to & 1]
        return others if until_ns is None or not mask & up else [*others, Send(self._uplink, frame, until_ns)]

    @property
    def data_ids(self) -> frozenset[int]:
        """CAN identifiers of the data that this PE forwards according to its slice."""
        return frozenset(self._data)

    def _has_room(self, port: int, now_ns: int) -> bool:
        """Tell whether a request of SDO may go out at a far port now; then it takes its time there."""
        each_ns, free_ns = self._each_ns[port], max(now_ns, self._free_ns[port])
        if free_ns - now_ns > (MOST_AT_ONCE - 1) * each_ns:
            return False
        self._free_ns[port] = free_ns + each_ns
        return True

    def _is_due(self, port: int, command: Command, meaning: bytes, now_ns: int) -> bool:
        """Tell whether to forward a LEASE or ALIVE: at once if its content is new, else once in a heartbeat period."""
        period_ns = self._ports[port].heartbeat_ns
        said, due_ns = self._last.get((port, command), (b"", now_ns))
        if said == meaning and now_ns < due_ns - slack_ns(period_ns):
            return False
        follows = said == meaning and now_ns < due_ns + period_ns
        self._last[port, command] = (meaning, (due_ns if follows else now_ns) + period_ns)
        return True


def _told_up(nodes: frozenset[int]) -> list[int]:
    told = (emergency_event_id, state_id, emcy_id, heartbeat_id, actuator_echo_id)
    return [identify(node) for node in nodes for identify in told]
