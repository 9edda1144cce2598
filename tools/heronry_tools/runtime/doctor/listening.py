"""The check of a bus by listening: what the received frames show of its wiring, its managers and its nodes.

    bus        error frames, or no frame at all
    manager    no active manager, or two
    node-ID    a node-ID that two nodes use
    nodes      nodes that are missing, and nodes that are not in the spec
    foreign    what other equipment sends, compared with what the spec declares
    late       states of PEs that came late
    load       more frames than the spec allows
    clock      whether this computer's clock was set while listening

`Hearing` takes the frames and the readings of the clocks. `assess_hearing` makes findings of them.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from heronry_tools.reports.findings import Finding
from heronry_tools.runtime.doctor.expected import Expected
from heronry_wire.controller import ControllerState, read_error_frame
from heronry_wire.frame import Frame
from heronry_wire.identifiers import MANAGER_NODES, PE_NODES, Command, Use, classify, management_id, state_id
from heronry_wire.management import Lease, decode_command
from heronry_wire.state_frames import StatePage0, decode_state
from heronry_wire.timing import worst_bits

if TYPE_CHECKING:
    from heronry_dg.model import Foreign

_NS_PER_S, _NS_PER_MS = 1_000_000_000, 1_000_000
_LATE_PERIODS = (
    2  # a state that comes so long after the one before is late; after `misses` and a quarter the PE is lost
)
_SHARED = frozenset((Use.NMT, Use.TIME, Use.NODE_SERVICE, Use.BULK))
CLOCK_STEP_NS = 10_000_000
_LEASES = {management_id(node, Command.LEASE): node for node in MANAGER_NODES}
_STATES = {state_id(node): node for node in PE_NODES}


@dataclass(frozen=True, slots=True)
class BusNamed:
    """The bus as the user named it, so that a remedy can name it in the same way."""

    interface: str = "socketcan"
    channel: str = "can0"

    @property
    def flags(self) -> str:
        """Return the options `-i` and `-c` by which a command line names the bus."""
        return f"-i {self.interface} -c {self.channel}"

    def start_agents(self, where: str) -> str:
        """Return the command that starts the agents of PEs, as advice for the user.

        where: words that say on which computers to run the command; used only if the interface is socketcan.
        """
        if self.interface == "socketcan":
            return f"systemctl start heronry-agent@PE   ({where})"
        return f"pe-agent --table PE.table {self.flags}   (for each PE)"

    def stop_manager(self) -> str:
        """Return the command that ends one of two managers, as advice for the user."""
        if self.interface == "socketcan":
            return "systemctl stop heronry-manager@SPEC   (on one of them)"
        return "kill PID   (of one of the processes 'heronry manager')"


_CAN0 = BusNamed()


@dataclass(slots=True)
class Sender:
    """The frames of one identifier: their number, their bits in all, and the data bytes of the longest."""

    frames: int = 0
    bits: int = 0
    most_bytes: int = 0


@dataclass(slots=True)
class Beats:
    """The states of one PE: when the first and the last of them came, and the longest time between two of them, in ns.

    Only page 0 counts, which a PE sends once in each heartbeat period.
    """

    first_ns: int
    last_ns: int
    longest_ns: int = 0

    def beat(self, t_ns: int) -> None:
        """Count a state that came at `t_ns`."""
        self.longest_ns = max(self.longest_ns, t_ns - self.last_ns)
        self.last_ns = t_ns


@dataclass(slots=True)
class Hearing:
    """What was heard on a bus so far."""

    frames: int = 0
    errors: Counter[str] = field(default_factory=Counter)
    is_bus_off: bool = False
    terms: dict[int, int] = field(default_factory=dict)  # manager -> term
    incarnations: dict[int, list[int]] = field(
        default_factory=dict
    )  # PE -> its incarnations, one entry for each change
    beats: dict[int, Beats] = field(default_factory=dict)  # by PE
    on_channel: dict[str, set[int]] = field(default_factory=dict)  # of a replicated bus: channel -> nodes heard there
    by_identifier: dict[tuple[bool, int], Sender] = field(default_factory=dict)  # (whether it has 29 bits, identifier)
    clock_step_ns: int = 0  # the largest step of the wall clock
    _offset_ns: int | None = None

    def take(self, frame: Frame, t_ns: int) -> None:
        """Count a frame of the bus that ended at `t_ns`, or an error frame of the controller."""
        if frame.error:
            report = read_error_frame(frame)
            self.errors.update(report.kinds)
            self.is_bus_off |= report.state is ControllerState.BUS_OFF
            return
        self.frames += 1
        sender = self.by_identifier.setdefault((frame.extended, frame.can_id), Sender())
        sender.frames += 1
        sender.bits += worst_bits(len(frame.data), extended=frame.extended)
        sender.most_bytes = max(sender.most_bytes, len(frame.data))
        if frame.extended or frame.remote:
            return
        if frame.can_id in _LEASES:
            lease = decode_command(Command.LEASE, frame.data)
            if isinstance(lease, Lease):
                self.terms[_LEASES[frame.can_id]] = lease.term
        elif frame.can_id in _STATES:
            page = decode_state(frame.data)
            if isinstance(page, StatePage0):
                node = _STATES[frame.can_id]
                self.beats.setdefault(node, Beats(t_ns, t_ns)).beat(t_ns)
                seen = self.incarnations.setdefault(node, [])
                if seen[-1:] != [page.incarnation]:
                    seen.append(page.incarnation)

    def take_copy(self, channel: str, frame: Frame) -> None:
        """Note on which channel of a replicated bus a node was heard.

        The caller passes both copies of a frame to this method, and only one of them to `take`, which counts it.
        """
        speaker = _STATES.get(frame.can_id, _LEASES.get(frame.can_id))
        if speaker is not None and not (frame.extended or frame.remote or frame.error):
            self.on_channel[channel].add(speaker)

    def clocks(self, wall_ns: int, monotonic_ns: int) -> None:
        """Take readings of the wall clock and of the monotonic clock, both from the same moment.

        The difference of the two clocks changes if the wall clock is set. `clock_step_ns` keeps the largest
        change from one call to the next.
        """
        offset_ns = wall_ns - monotonic_ns
        if self._offset_ns is not None:
            self.clock_step_ns = max(self.clock_step_ns, abs(offset_ns - self._offset_ns))
        self._offset_ns = offset_ns


def assess_hearing(
    heard: Hearing, expected: Expected | None, seconds: float, bus: BusNamed = _CAN0
) -> Iterator[Finding]:
    """Yield findings about the frames that were heard in `seconds` on this bus.

    expected: has the PEs of the bus; None: no PE is reported as missing or as not in the spec.
    """
    yield assess_traffic(heard, seconds, bus)
    yield assess_managers(heard, bus)
    yield from assess_twins(heard)
    yield from _assess_nodes(heard, expected, bus)
    if expected is not None:
        yield from assess_beats(heard, expected)
        yield from assess_load(heard, expected, seconds)
        yield from assess_foreign(heard, expected, seconds)
    yield assess_clock(heard)


def assess_clock(heard: Hearing) -> Finding:
    """Return the finding about this computer's clock: whether it was set while listening."""
    if heard.clock_step_ns > CLOCK_STEP_NS:
        says = f"the clock of this computer was set by {heard.clock_step_ns / 1e6:.0f} ms: dates in logs jump"
        return Finding("clock", says, "timedatectl set-ntp true   (and start the nodes when the time is right)")
    return Finding("clock", "the clock of this computer was not set while listening")


def assess_beats(heard: Hearing, expected: Expected) -> Iterator[Finding]:
    """Yield findings about PEs whose states come late, by more than one heartbeat period.

    After `misses` periods, usually three, a PE counts as lost.
    """
    judged = {node: beats for node, beats in heard.beats.items() if node in expected.periods_ns}
    late = {n: beats for n, beats in judged.items() if beats.longest_ns > _LATE_PERIODS * expected.periods_ns[n]}
    for node, beats in late.items():
        period_ms = expected.periods_ns[node] / _NS_PER_MS
        says = f"{expected.pes[node]} was silent for {beats.longest_ns / _NS_PER_MS:.0f} ms"
        remedy = f"top   (on the computer of {expected.pes[node]}: what else runs there?)"
        yield Finding("late", f"{says}, and sends its state every {period_ms:g} ms", remedy)
    if judged and not late:
        node = max(judged, key=lambda one: judged[one].longest_ns / expected.periods_ns[one])
        longest_ms, period_ms = judged[node].longest_ns / _NS_PER_MS, expected.periods_ns[node] / _NS_PER_MS
        yield Finding("late", f"no state came late; the longest silence was {longest_ms:.0f} ms of {period_ms:g} ms")


def assess_load(heard: Hearing, expected: Expected, seconds: float) -> Iterator[Finding]:
    """Yield the finding about the load of the bus; the worst case of bit stuffing counts, as in the analysis."""
    if expected.most_load is None:
        return
    load = sum(sender.bits for sender in heard.by_identifier.values()) / seconds / expected.bitrate
    says = f"{load:.1%} of the bit rate are used, and {expected.most_load:.0%} may be"
    remedy = "heronry bus SPEC   (what the plan sends; 'heronry top' shows what is sent: find who sends more)"
    yield Finding("load", says, remedy if load > expected.most_load else None)


def assess_foreign(heard: Hearing, expected: Expected, seconds: float) -> Iterator[Finding]:
    """Yield a finding about each declared foreign sender, and about each identifier that is heard and not declared.

    Loads count the worst case of bit stuffing, as the analysis does. Commands of CANopen, node services and bulk
    transfers are nobody's in particular, so they are left out.
    """
    if expected.own is None:
        return
    left = {
        (extended, can_id): sender
        for (extended, can_id), sender in sorted(heard.by_identifier.items())
        if extended or (can_id not in expected.own and classify(can_id).use not in _SHARED)
    }
    for one in expected.foreign:
        mine = [key for key in left if key[0] == one.extended and one.first <= key[1] <= one.last]
        yield _assess_declared(one, [left.pop(key) for key in mine], expected.bitrate, seconds)
    for (extended, can_id), sender in left.items():
        period_ms = math.floor(seconds * 1000 / sender.frames * 1000) / 1000
        says = f"{_identifier(can_id, can_id, extended=extended)} is not declared: {_load(sender, expected, seconds)}"
        entry = f"identifier: {can_id}, {'extended: true, ' if extended else ''}bytes: {sender.most_bytes}"
        yield Finding("foreign", says, f"add to 'foreign' of the bus: {{{entry}, period_ms: {period_ms:g}}}")


def _assess_declared(one: "Foreign", senders: list[Sender], bitrate: int, seconds: float) -> Finding:
    frames, bits = sum(sender.frames for sender in senders), sum(sender.bits for sender in senders)
    longest = max((sender.most_bytes for sender in senders), default=0)
    most = math.ceil(seconds * _NS_PER_S / one.period_ns) + 1  # one may have waited when listening began
    named = _identifier(one.first, one.last, extended=one.extended)
    declared = one.bits * _NS_PER_S / one.period_ns / bitrate
    says = f"{named}: {bits / seconds / bitrate:.2%} of the bit rate, {declared:.2%} declared"
    if frames > most:
        remedy = f"correct period_ms in the spec: {frames} frames came in {seconds:g} s, and {most} may"
        return Finding("foreign", says, remedy)
    if longest > one.data_bytes:
        return Finding("foreign", says, f"correct bytes in the spec: a frame has {longest} data bytes")
    return Finding("foreign", says if frames else f"{named}: not heard, {declared:.2%} declared")


def _load(sender: Sender, expected: Expected, seconds: float) -> str:
    return f"{sender.frames / seconds:.4g} frames/s, {sender.bits / seconds / expected.bitrate:.2%} of the bit rate"


def _identifier(first: int, last: int, *, extended: bool) -> str:
    span = f"identifier {first}" if first == last else f"identifiers {first} to {last}"
    return f"{span} (29 bits)" if extended else span


def assess_channels(heard: Hearing, expected: Expected | None) -> Finding:
    """Return the finding about a replicated bus: whether every node that is heard is heard on both channels.

    expected: has the names of the nodes; None: the finding names nodes by their node-IDs.
    """
    names = {} if expected is None else expected.pes
    all_nodes = set().union(*heard.on_channel.values())
    lacking = [
        f"{', '.join(names.get(node, str(node)) for node in sorted(all_nodes - there))} on {channel}"
        for channel, there in heard.on_channel.items()
        if all_nodes - there
    ]
    if lacking:
        remedy = "check the wire of that channel: all of it if no node is heard there, else the stub of the node"
        return Finding("channels", f"not heard: {'; '.join(lacking)}", remedy)
    return Finding("channels", f"every node is heard on {' and on '.join(heard.on_channel)}")


def assess_traffic(heard: Hearing, seconds: float, bus: BusNamed) -> Finding:
    """Return the finding about frames and error frames; `bus`: for the remedy where there are none."""
    told = "".join(f", {kind} {times}" for kind, times in sorted(heard.errors.items()))
    if heard.is_bus_off or heard.errors:
        remedy = "check termination (120 ohm at both ends), wiring, and the bit rate of every node"
        return Finding("bus", f"{heard.frames} frames in {seconds:g} s, and errors{told}", remedy)
    if not heard.frames:
        return Finding("bus", f"nothing was heard in {seconds:g} s", bus.start_agents("on the nodes"))
    return Finding("bus", f"{heard.frames} frames in {seconds:g} s, without errors")


def assess_managers(heard: Hearing, bus: BusNamed) -> Finding:
    """Return the finding about the managers that are active: there should be one."""
    is_active = ", ".join(f"{node} (term {term})" for node, term in sorted(heard.terms.items()))
    if not heard.terms:
        return Finding("manager", "no manager is heard", f"heronry manager SPEC {bus.flags}")
    if len(heard.terms) > 1:
        return Finding("manager", f"two managers are active: {is_active}", bus.stop_manager())
    return Finding("manager", f"one manager is active: {is_active}")


def assess_twins(heard: Hearing) -> Iterator[Finding]:
    """Yield a finding for each node-ID that two nodes use."""
    for node, seen in sorted(heard.incarnations.items()):
        if len(seen) > len(set(seen)):  # one, another, and the first again: no single computer sends that
            says = f"two nodes have node-ID {node}"
            yield Finding("node-ID", says, "give one of them another node_id in the spec, and its new table")


def _assess_nodes(heard: Hearing, expected: Expected | None, bus: BusNamed) -> Iterator[Finding]:
    names = {} if expected is None else expected.pes
    missing = [f"{name} ({node})" for node, name in names.items() if node not in heard.incarnations]
    if missing:
        yield Finding("nodes", f"not heard: {', '.join(missing)}", bus.start_agents("on each of them"))
    strangers = [str(node) for node in heard.incarnations if expected is not None and node not in names]
    if strangers:
        says = f"not in {expected.spec if expected else 'the spec'}: node {', '.join(strangers)}"
        yield Finding("nodes", says, "stop them, or give them the table of this spec")
    if not missing and not strangers:
        told = ", ".join(names.get(node, str(node)) for node in sorted(heard.incarnations)) or "none"
        yield Finding("nodes", f"heard: {told}")
