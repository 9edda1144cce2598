"""The messages on the buses as text: one line a message, with its longest response time, and the totals of each bus.

The lines of the shipped specs fit a terminal of 80 columns. The JSON form has the values that the lines leave out:
bytes, deadlines, slack.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction

from heronry_dg.bus_schedule import BusSchedule, ScheduledMessage
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.console.text_tables import Bad, Bar, Cell, Table, print_tables

_COLUMNS = ("id", "message", "from", "period", "worst", "load")


def print_buses(spec: Spec, now: Situation, schedules: Sequence[BusSchedule]) -> None:
    """Print the messages of the buses in `schedules` to standard output, under a headline with the situation `now`."""
    tables = [table for schedule in schedules for table in _tables(schedule)]
    print_tables(_headline(spec, now), tables)


def document(spec: Spec, now: Situation, schedules: Sequence[BusSchedule]) -> dict[str, object]:
    """Return the messages of these buses as plain data for JSON; times in nanoseconds."""
    return {
        "spec": spec.digest,
        "phase": now.phase,
        "down": sorted(now.down),
        "buses": {schedule.bus.name: _bus_document(schedule) for schedule in schedules},
    }


def _headline(spec: Spec, now: Situation) -> str:
    phase = f", phase {now.phase}" if now.phase is not None else ""
    down = f", down: {', '.join(sorted(now.down))}" if now.down else ", nothing down"
    return f"{spec.name}{phase}{down}; times in ms"


def _tables(schedule: BusSchedule) -> Iterator[Table]:
    bus = schedule.bus
    yield Table((f"bus {bus.name}", f"{bus.bitrate} bit/s, {bus.kind}"), list(_totals(schedule)))
    if schedule.is_up:
        yield Table(_COLUMNS, [_row(schedule, message) for message in schedule.messages])


def _totals(schedule: BusSchedule) -> Iterator[Sequence[Cell]]:
    bus = schedule.bus
    if not schedule.is_up:
        yield "", Bad("is down")
        return
    yield "data", _share(schedule.data, schedule.data_limit)
    if schedule.checkpoints:
        yield "checkpoints", _share(schedule.checkpoints, schedule.data_limit - schedule.data)
    yield "management", _share(schedule.management, bus.reserve)
    yield "", f"the reserve has room for {schedule.reserve_left_frames_per_s} frames/s more"
    if bus.foreign:
        yield "foreign", f"{float(schedule.foreign):.2%}"
    yield "together", _share(schedule.together, bus.max_load)
    if bus.kind == "wired":
        yield "blocking", f"{_ms(schedule.blocking_ns)}, by a frame of lower priority that has just started"
    else:
        yield "", "response times are computed for wired buses only"


def _row(schedule: BusSchedule, message: ScheduledMessage) -> Sequence[Cell]:
    return (
        message.identifier_text,
        message.name,
        message.node if message.producer is None else f"{message.node}/{message.producer}",
        f"{message.period_ns / 1_000_000:g}",
        _worst(schedule, message),
        f"{float(schedule.share(message)):.2%}",
    )


def _worst(schedule: BusSchedule, message: ScheduledMessage) -> Cell:
    """Write the longest time in ms until a message is received; also its deadline, if the message may miss it.

    If there is no bound for this time, the text says so. On a bus that is not wired, the text is "-".
    """
    if schedule.bus.kind != "wired":
        return "-"
    if message.response_ns is None or message.slack_ns is None:
        return Bad("no bound")
    if message.slack_ns < 0:
        return Bad(f"{_ms(message.response_ns)} > {message.deadline_ns / 1_000_000:g}")
    return _ms(message.response_ns)


def _share(used: Fraction, limit: Fraction) -> Bar | Bad:
    text = f"{float(used):.2%} of {float(limit):.2%}"
    return Bad(f"{text}: TOO MUCH") if used > limit else Bar(float(used / limit) if limit else 0.0, text)


def _ms(time_ns: int) -> str:
    return f"{time_ns / 1_000_000:.3f}"


def _bus_document(schedule: BusSchedule) -> dict[str, object]:
    bus = schedule.bus
    return {
        "bitrate": bus.bitrate,
        "kind": bus.kind,
        "up": schedule.is_up,
        "data_load": float(schedule.data),
        "data_limit": float(schedule.data_limit),
        "checkpoint_load": float(schedule.checkpoints),
        "management_load": float(schedule.management),
        "foreign_load": float(schedule.foreign),
        "reserve": float(bus.reserve),
        "max_load": float(bus.max_load),
        "reserve_left_frames_per_s": schedule.reserve_left_frames_per_s,
        "blocking_ns": schedule.blocking_ns,
        "messages": [_message_document(schedule, message) for message in schedule.messages],
    }


def _message_document(schedule: BusSchedule, message: ScheduledMessage) -> dict[str, object]:
    return {
        "identifier": message.identifier,
        "last": message.last,
        "extended": message.extended,
        "kind": message.kind,
        "name": message.name,
        "producer": message.producer,
        "node": message.node,
        "data_bytes": message.data_bytes,
        "bits": message.bits,
        "period_ns": message.period_ns,
        "response_ns": message.response_ns,
        "deadline_ns": message.deadline_ns,
        "slack_ns": message.slack_ns,
        "load": float(schedule.share(message)),
    }
