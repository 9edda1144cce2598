"""Reads a recording: the masterships of its managers, and for each what the manager commanded and heard.

A *mastership* is identified by the sender (126 or 127) and the term of its LEASEs. It begins T_lease before its first
LEASE, since a manager listens for T_lease before it sends. It ends with its last LEASE. A *decision* is the first
PREPARE of an epoch, or the first ACTIVATE of an epoch with a certain step; repetitions are no decisions.

A mastership whose beginning was not recorded cannot be replayed: decisions before the recording are unknown. Such a
mastership is recognized by its first LEASE, which already names an epoch.

Lines that are no frames are counted. A recording may hold several buses, which differ in the name of the channel. The
user may name the channel of the manager's bus. Without this name, the manager's bus is the only channel, or the channel
that has the name of the bus in the spec. For a replicated bus the user may name both channels, separated by a comma;
each frame then counts once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.recording.recorded_folder import is_recorded_folder, log_of
from heronry_wire.channel_merge import ChannelMerge
from heronry_wire.frame import Frame, LoggedFrame, Malformed, parse_log_line
from heronry_wire.identifiers import MANAGER_NODES, Command, heartbeat_id, management_id
from heronry_wire.management import Activate, Lease, Prepare, decode_command
from heronry_wire.protocol_times import t_lease_ns

_COMMANDS = {management_id(node, command): (node, command) for node in MANAGER_NODES for command in Command}
_SAID_BY = {identifier: node for identifier, (node, _) in _COMMANDS.items()}
_SAID_BY |= {heartbeat_id(node): node for node in MANAGER_NODES}


@dataclass(frozen=True, slots=True)
class Decision:
    """A PREPARE or an ACTIVATE that a manager has sent for an epoch.

    Decisions that differ only in `t_ns` are equal.
    """

    t_ns: int = field(compare=False)
    what: str  # PREPARE, or the name of the step of an ACTIVATE
    epoch: int
    digest: int

    def __str__(self) -> str:
        return f"{self.what} epoch {self.epoch} ({self.digest:06X})"


@dataclass(slots=True)
class RecordedMastership:
    """One mastership in a recording; times are in ns on the clock of the recording."""

    node: int
    term: int
    first_ns: int  # of LEASE
    last_ns: int
    epoch: int  # named by the first LEASE; 0: none yet
    heard: list[tuple[int, Frame]] = field(default_factory=list)  # by the manager, since it began to listen
    said: list[tuple[int, Command, Frame]] = field(default_factory=list)  # commands that it sent
    decisions: list[Decision] = field(default_factory=list)
    leases: list[tuple[int, Lease]] = field(default_factory=list)

    def calls_by_number(self) -> bool:
        """Tell whether contingencies were on board: some PREPARE of this mastership names one by its number."""
        prepared = (decode_command(command, frame.data) for _, command, frame in self.said)
        return any(isinstance(message, Prepare) and message.contingency for message in prepared)


def read_recording(path: Path) -> tuple[list[LoggedFrame], int]:
    """Read a candump log, or a folder of 'heronry record'.

    Returns its frames in order of time, and the number of lines that are no frames. Raises UserError if no line is a
    frame, and OSError if the file cannot be read.
    """
    if is_recorded_folder(path):
        return log_of(path), 0
    lines = [line for line in path.read_text(encoding="ascii", errors="replace").splitlines() if line.strip()]
    parsed = [parse_log_line(line) for line in lines]
    frames = [one for one in parsed if not isinstance(one, Malformed)]
    if not frames:
        raise UserError(f"{path} holds no frame; give a log as written by 'candump -L' or 'heronry demo --record'")
    return sorted(frames, key=lambda logged: logged.time_ns), len(parsed) - len(frames)


def on_the_managers_bus(spec: Spec, frames: Sequence[LoggedFrame], channel: str | None) -> list[LoggedFrame]:
    """Return the frames of the manager's bus.

    channel: the name of that bus in the recording; for a replicated bus the names of both channels, separated by a
        comma. None: the only channel, or the channel that has the name of the bus in the spec.
    Raises UserError if no frame of the recording is on one of these channels.
    """
    channels = list(dict.fromkeys(logged.channel for logged in frames))
    if channel is None:
        channel = spec.manager.bus if spec.manager.bus in channels or len(channels) > 1 else channels[0]
    bus = spec.buses[spec.manager.bus]
    names = channel.split(",") if bus.channels > 1 else [channel]
    for name in names:
        if name not in channels:
            known = ", ".join(channels)
            raise UserError(
                f"no frame of the recording is on {name!r} (the recording has {known}); for 'heronry replay', name the "
                "manager's bus with --channel; for other commands, write the names of the spec's buses into the log"
            )
    on_the_bus = [logged for logged in frames if logged.channel in names]
    if len(names) == 1:
        return on_the_bus
    merge = ChannelMerge(bus.heartbeat_ns)
    return [one for one in on_the_bus if merge.take(names.index(one.channel), one.frame, one.time_ns)]


def masterships(spec: Spec, frames: Sequence[LoggedFrame]) -> list[RecordedMastership]:
    """Return every mastership on the manager's bus, in the order of their first LEASEs."""
    found: list[RecordedMastership] = []
    for logged in frames:
        node, command = _COMMANDS.get(logged.frame.can_id, (None, None))
        if node is not None and command is not None and not logged.frame.extended:
            _follow(found, node, command, logged)
    listening_ns = t_lease_ns(spec.buses[spec.manager.bus].heartbeat_ns)
    for mastership in found:
        began_ns = mastership.first_ns - listening_ns
        mastership.heard = [
            (logged.time_ns, logged.frame)
            for logged in frames
            if began_ns <= logged.time_ns <= mastership.last_ns and _SAID_BY.get(logged.frame.can_id) != mastership.node
        ]
    return found


def decision_of(node: int, t_ns: int, frame: Frame) -> Decision | None:
    """Return the decision that a frame of manager `node` carries; None if it carries none."""
    of, command = _COMMANDS.get(frame.can_id, (None, None))
    if frame.extended or command is None or of != node:
        return None
    match decode_command(command, frame.data):
        case Prepare(epoch=epoch, digest=digest):
            return Decision(t_ns, "PREPARE", epoch, digest)
        case Activate(epoch=epoch, step=step, digest=digest):
            return Decision(t_ns, step.name, epoch, digest)
        case _:
            return None


def note(decisions: list[Decision], decision: Decision | None) -> None:
    """Append a decision to a list, except if the list already has it."""
    if decision is not None and decision not in decisions:
        decisions.append(decision)


def _follow(found: list[RecordedMastership], node: int, command: Command, logged: LoggedFrame) -> None:
    """Add a command to the mastership of its sender; a LEASE with another term begins a new mastership."""
    t_ns, frame = logged.time_ns, logged.frame
    mastership = next((known for known in reversed(found) if known.node == node), None)
    message = decode_command(command, frame.data)
    if isinstance(message, Lease):
        if mastership is None or mastership.term != message.term:
            mastership = RecordedMastership(node, message.term, t_ns, t_ns, message.epoch)
            found.append(mastership)
        mastership.last_ns = t_ns
        mastership.leases.append((t_ns, message))
    if mastership is None:
        return
    mastership.said.append((t_ns, command, frame))
    note(mastership.decisions, decision_of(node, t_ns, frame))
