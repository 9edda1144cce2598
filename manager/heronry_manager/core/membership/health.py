"""Keeps the standing of each PE, which tells whether the PE is available to the manager.

The standing is WAITING, UP, SUSPECT, DOWN or RETURNING; `standing` has the table of all changes. Three things change
the standing: a frame of the PE, the time, and a decision of the manager or the operator to fail the PE. To send a
command to a PE never changes its standing.

Time       A beat (state frame) is late a quarter of a period after it was due. A PE is declared down `misses` periods
           and a quarter after its last beat. With this quarter, a beat that is still on its way at the end of the last
           period counts. A pause of the manager makes no PE late: the driver hands over all frames before it reports a
           deadline.

Reboot     If the incarnation of a PE has changed, the PE has rebooted, and what ran on it has stopped. This is so even
           if no beat was missed. The PE becomes DOWN, and with the same frame RETURNING, unless it is barred. If a PE
           reports UNCONFIGURED although it was given a configuration, the manager fails this PE (`deployment`).

Hold-down  With each further loss the hold-down of a PE doubles, up to a minute. A hold-down longer than the shortest
           one is called quarantine. The losses are forgiven when the PE has been available for a minute, or when the
           operator lets it in (`forgive`). If this manager itself has heard nothing, the losses of the PEs are
           discounted (`discount_losses`). So a manager whose receiver fails now and then does not put all PEs into
           quarantine.

Receiver   A PE whose receiver has failed may still send. It then reports that it hears no LEASE. If it reports this for
           longer than T_lease of the slowest bus on the way to it, although the manager sends, no command reaches the
           PE. After this time the PE has certainly released everything exclusive. So the manager fails the PE, until
           the PE hears a LEASE again. If more than half of the available PEs report that they hear no LEASE, the fault
           is on the manager's side. Then no PE is failed, and the running configuration continues.

Takeover   Two rules hold for a PE that was available to the previous manager:
           - If the PE has proven nothing to this manager yet, it becomes WAITING again (`await_again`). ALIVE names it
             until the start-up window closes, and its outputs are given to no other PE in this time. If the PE stops
             sending, it becomes DOWN, and the manager no longer waits for it.
           - If the PE still runs the previous manager's configuration, it is not held down (`inherited`), since only
             this manager did not hear it.

Barred     A PE on which a fault is latched stays DOWN, whatever it sends, until the fault is cleared.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from heronry_dg.model import Spec
from heronry_manager.core.membership.standing import STANDING_TRANSITIONS, Standing, StandingEvent
from heronry_manager.core.topology import command_period_ns, uplink_bus
from heronry_wire.protocol_times import (
    FORGIVEN_AFTER_NS,
    HOLD_DOWN_PERIODS,
    LONGEST_HOLD_DOWN_NS,
    heard_ns,
    late_ns,
    silent_ns,
    t_lease_ns,
)
from heronry_wire.sansio import NEVER_NS

_LONG_AGO_NS = -NEVER_NS


class Change(Enum):
    """Kinds of changes of a PE's health that the manager notices."""

    JOINED = "joined"  # available from now on
    SUSPECTED = "suspected"
    ANSWERED = "answered"  # a suspect, heard again in time
    LOST = "lost"  # was available, and is silent
    FAILED = "failed"  # was available, and does not do what it was commanded; it may still drive what it drove
    REBOOTED = "rebooted"  # was available; what ran there has certainly stopped
    ABSENT = "absent"  # not heard before the start-up window closed
    HEARD_AGAIN = "heard again"  # hold-down begins


@dataclass(frozen=True, slots=True)
class HealthChange:
    """One change of a PE's health.

    cause: the reason for the change, in words.
    last_heard_ns: time of the last frame of the PE before the change; None: the PE was never heard.
    """

    pe: str
    change: Change
    cause: str
    last_heard_ns: int | None


@dataclass(slots=True)
class _Record:
    name: str
    period_ns: int
    misses: int
    command_period_ns: int  # of LEASE, where it arrives
    late_after_ns: int  # these two are read with every frame, and never change
    silent_after_ns: int
    standing: Standing = Standing.WAITING
    heard_ns: int | None = None
    incarnation: int | None = None
    returning_since_ns: int = 0
    joined_ns: int = 0
    losses: int = 0  # since it was last forgiven
    lost_ns: int | None = None  # when the last one of these was counted
    cause: str | None = None  # of being down
    receive_failed_since_ns: int | None = None  # since when it has reported that it hears no lease
    barred: bool = False
    excluded: bool = False  # until its next incarnation
    awaited_again: bool = False  # it was available to the previous manager
    spoke_ns: int = 0  # when it last sent a state, believed or not
    said: int | None = None  # its incarnation in its last state, proven or not
    said_since_ns: int = 0

    def move(self, event: StandingEvent) -> None:
        """Change the standing by an event; raises InvariantError if the table in `standing` has no row for it."""
        self.standing = STANDING_TRANSITIONS.after(self.standing, event)

    def says(self, incarnation: int, now_ns: int) -> None:
        if incarnation != self.said:
            self.said, self.said_since_ns = incarnation, now_ns

    def suspect_ns(self) -> int:
        return (self.heard_ns or 0) + self.late_after_ns

    def declare_ns(self) -> int:
        return (self.heard_ns or 0) + self.silent_after_ns

    def fallen_silent_ns(self) -> int:
        return self.spoke_ns + self.silent_after_ns

    def receive_has_failed(self, now_ns: int) -> bool:
        return self.receive_failed_since_ns is not None and now_ns - self.receive_failed_since_ns > t_lease_ns(
            self.command_period_ns
        )

    def is_held_down(self, now_ns: int) -> bool:
        return self.receive_failed_since_ns is not None or now_ns < self.returning_since_ns + self.hold_down_ns()

    def hold_down_ns(self) -> int:
        return min(self.period_ns * HOLD_DOWN_PERIODS << max(0, self.losses - 1), LONGEST_HOLD_DOWN_NS)


class Health:
    """Keeps the standing of every PE of a spec."""

    def __init__(self, spec: Spec, now_ns: int, window_ns: int) -> None:
        """Begin at `now_ns` to wait for PEs that were never heard; the start-up window closes `window_ns` later."""
        self._spec, self._window_ns = spec, window_ns
        self.forget(now_ns)

    def forget(self, now_ns: int) -> None:
        """Forget what was heard of any PE: from `now_ns` on, wait for each as at the beginning."""
        spec = self._spec
        self._window_closes_ns: int | None = now_ns + self._window_ns
        self._records: dict[str, _Record] = {}
        for pe in spec.pes.values():
            bus = spec.buses[uplink_bus(spec, pe.name)]
            self._records[pe.name] = _Record(
                pe.name,
                bus.heartbeat_ns,
                bus.misses,
                command_period_ns(spec, pe.name),
                late_ns(bus.heartbeat_ns),
                silent_ns(bus.heartbeat_ns, bus.misses),
            )

    def standing(self, pe: str) -> Standing:
        """Return the standing of a PE: waiting, up, suspect, down or returning."""
        return self._records[pe].standing

    def cause(self, pe: str) -> str | None:
        """Return the reason why a PE is not available; None: it is available, or may still be starting."""
        return self._records[pe].cause

    def incarnation(self, pe: str) -> int | None:
        """Return the boot count in the last believed page 0 of a PE; None: no such page has come."""
        return self._records[pe].incarnation

    def said_incarnation(self, pe: str, since_ns: int) -> int | None:
        """Return the boot count that a PE reported last, proven or not.

        None: the PE has reported none, or its boot count has changed after `since_ns`.
        """
        record = self._records[pe]
        return record.said if record.said_since_ns <= since_ns else None

    def losses(self, pe: str) -> int:
        """Return the number of a PE's losses since they were last forgiven."""
        return self._records[pe].losses

    def held_down_for_ns(self, pe: str, now_ns: int) -> int | None:
        """Return how long a returning PE is still held down, in nanoseconds; None: the PE is in another standing."""
        record = self._records[pe]
        if record.standing is not Standing.RETURNING:
            return None
        return max(0, record.returning_since_ns + record.hold_down_ns() - now_ns)

    def is_available(self, pe: str) -> bool:
        """Tell whether a PE is UP or SUSPECT."""
        return self._records[pe].standing in (Standing.UP, Standing.SUSPECT)

    def spoke_last_ns(self, pe: str) -> int:
        """Return the time (ns) of the last state frame of a PE, proven or not; far in the past: it never sent one."""
        record = self._records[pe]
        return max(_LONG_AGO_NS if record.heard_ns is None else record.heard_ns, record.spoke_ns or _LONG_AGO_NS)

    def available(self) -> list[str]:
        """Return the PEs that are UP or SUSPECT, in the spec's order."""
        return [r.name for r in self._records.values() if r.standing in (Standing.UP, Standing.SUSPECT)]

    def suspects_any(self) -> bool:
        """Tell whether a PE is SUSPECT: its state is late, and it is not declared down yet."""
        return any(record.standing is Standing.SUSPECT for record in self._records.values())

    def hears_no_pe(self, now_ns: int) -> bool:
        """Tell whether this manager hears no PE any more.

        The answer is yes if no PE is available, and each PE has been silent for `misses` periods and a quarter. A PE
        that was never heard is ignored. If no PE has ever sent a proven state, unproven states are used instead.
        """
        if self.available():
            return False
        records = self._records.values()
        silent_ns = [record.declare_ns() for record in records if record.heard_ns is not None]
        silent_ns = silent_ns or [record.fallen_silent_ns() for record in records if record.spoke_ns]
        return now_ns >= max(silent_ns, default=NEVER_NS)

    def discount_losses(self) -> list[str]:
        """Discount the last loss of each PE that was lost after this manager last heard any PE.

        Such a loss does not show a fault of the PE, since the manager itself heard nothing. Gives these PEs.
        """
        last_ns = max((record.heard_ns or 0 for record in self._records.values()), default=0)
        discounted = [r for r in self._records.values() if r.lost_ns is not None and r.lost_ns > last_ns]
        for record in discounted:
            record.losses, record.lost_ns = record.losses - 1, None
        return [record.name for record in discounted]

    def starting(self) -> bool:
        """Tell whether the start-up window is open: the manager waits for PEs that are WAITING."""
        return self._window_closes_ns is not None

    def period_ns(self, pe: str) -> int:
        """Return the heartbeat period of a PE on the bus on which it reports, in nanoseconds."""
        return self._records[pe].period_ns

    def heard(self, pe: str, incarnation: int | None, now_ns: int, *, hears_lease: bool = True) -> list[HealthChange]:
        """Note a state frame of a PE; gives the changes of its health.

        incarnation: boot count of the PE; None: this page does not have it.
        hears_lease: False if the PE reports that it hears no LEASE, although the manager sends it.
        """
        record = self._records[pe]
        last, record.heard_ns = record.heard_ns, now_ns
        record.receive_failed_since_ns = None if hears_lease else record.receive_failed_since_ns or now_ns
        changes: list[HealthChange] = []
        if incarnation is not None:
            if record.incarnation not in (None, incarnation):
                record.excluded = False
                cause = f"it rebooted (incarnation {incarnation})"
                changes += self._lose(record, last, now_ns, cause, Change.REBOOTED)
            record.incarnation = incarnation
            record.says(incarnation, now_ns)
        match record.standing:
            case Standing.UP:
                pass
            case Standing.WAITING:
                record.move(StandingEvent.HEARD)
                record.joined_ns = now_ns
                changes.append(HealthChange(pe, Change.JOINED, "heard for the first time", last))
                self._close_window_if_all_heard()
            case Standing.SUSPECT:
                record.move(StandingEvent.HEARD)
                changes.append(HealthChange(pe, Change.ANSWERED, "heard again in time", last))
            case Standing.DOWN if not record.barred and not record.excluded:
                record.move(StandingEvent.HEARD)
                record.returning_since_ns = now_ns
                wait_ms = record.hold_down_ns() // 1_000_000
                changes.append(HealthChange(pe, Change.HEARD_AGAIN, f"held down for {wait_ms} ms", last))
            case Standing.RETURNING | Standing.DOWN:  # pragma: no branch - nothing else is left
                pass
        return changes + self._fail_if_receive_failed(record, last, now_ns)

    def _fail_if_receive_failed(self, record: _Record, last_ns: int | None, now_ns: int) -> list[HealthChange]:
        """Fail a PE that reports for too long that it does not hear the manager; returns the changes.

        If more than half of the available PEs report this, no PE is failed: the fault may be the manager's.
        """
        if not record.receive_has_failed(now_ns) or not self.is_available(record.name):
            return []
        available = self.available()
        receive_failed = sum(self._records[pe].receive_failed_since_ns is not None for pe in available)
        if 2 * receive_failed > len(available):
            return []
        return self._lose(record, last_ns, now_ns, "it hears no lease", Change.FAILED)

    def in_flight(self, now_ns: int) -> None:
        """Shorten the start-up window, because some PE runs a configuration: the aircraft is in operation.

        Every PE that works is heard within `misses` + 1 of its heartbeat periods, so the window need not be longer.
        """
        if self._window_closes_ns is None:
            return
        waiting = [r for r in self._records.values() if r.standing is Standing.WAITING]
        longest_ns = max((heard_ns(r.period_ns, r.misses) for r in waiting), default=0)
        self._window_closes_ns = min(self._window_closes_ns, now_ns + longest_ns)

    def await_again(self, pes: Iterable[str], now_ns: int, window_ns: int) -> None:
        """Wait `window_ns` for those of these PEs that are not available; a PE with a latched fault is not awaited.

        pes: PEs that were available to the previous manager, but have proven nothing to this one.
        """
        for record in map(self._records.__getitem__, sorted(pes)):
            if not record.barred and not self.is_available(record.name):
                record.move(StandingEvent.AWAITED_AGAIN)
                record.cause, record.awaited_again = None, True
                record.spoke_ns = now_ns
                self._window_closes_ns = now_ns + window_ns

    def inherited(self, pes: Iterable[str], now_ns: int) -> list[HealthChange]:
        """Make those of the PEs `pes` that are in their hold-down (RETURNING) available now; returns the changes.

        These PEs were available to the previous manager, and run the configuration of that manager.
        """
        return [
            self._join(record, now_ns, StandingEvent.INHERITED, "it was available to the previous manager")
            for record in map(self._records.__getitem__, sorted(pes))
            if record.standing is Standing.RETURNING
        ]

    def spoke(self, pe: str, incarnation: int, now_ns: int) -> None:
        """Note that an unproven state of a PE has come, with its boot count; the standing of the PE does not change."""
        record = self._records[pe]
        record.spoke_ns = now_ns
        record.says(incarnation, now_ns)

    def awaited_again(self) -> list[str]:
        """Return the PEs for which the manager waits again since `await_again`.

        A PE is left out once one of its states is proven, once it falls silent, and when the start-up window closes.
        """
        return [r.name for r in self._records.values() if r.awaited_again and r.standing is Standing.WAITING]

    def bar(self, pe: str, cause: str, now_ns: int) -> list[HealthChange]:
        """Keep a PE unavailable until `forgive`, whatever it sends, because a fault is latched on it."""
        record = self._records[pe]
        record.barred, record.cause = True, cause
        return self._lose(record, record.heard_ns, now_ns, cause, Change.FAILED)

    def forgive(self, pe: str) -> bool:
        """Let a PE become available again after the shortest hold-down.

        Tells whether the PE was kept unavailable until now, by a latched fault (`bar`) or by quarantine.
        """
        record = self._records[pe]
        kept_out = record.barred or record.excluded or self.is_quarantined(pe)
        record.barred, record.excluded, record.losses = False, False, 0
        return kept_out

    def quarantine(self, pe: str, losses: int) -> None:
        """Restore the quarantine of a PE after a restart.

        When the PE is heard, it is held down as after `losses` losses.
        """
        record = self._records[pe]
        record.move(StandingEvent.QUARANTINED)
        record.losses, record.cause = losses, f"it was lost {losses} times"
        self._close_window_if_all_heard()

    def is_quarantined(self, pe: str) -> bool:
        """Tell whether a PE is not available, and has a longer hold-down than after a single loss."""
        return not self.is_available(pe) and self._records[pe].losses > 1

    def fail(self, pe: str, cause: str, now_ns: int) -> list[HealthChange]:
        """Fail a PE for a reason other than silence (no acknowledgement, configuration lost)."""
        record = self._records[pe]
        return self._lose(record, record.heard_ns, now_ns, cause, Change.FAILED)

    def exclude(self, pe: str, cause: str, now_ns: int) -> list[HealthChange]:
        """Keep a PE unavailable until it has restarted, whatever it sends; this is no loss that lengthens a hold-down.

        Returns the changes of its health. `forgive` ends this, too.
        """
        record = self._records[pe]
        before = record.losses, record.lost_ns
        record.excluded, record.cause = True, cause
        changes = self._lose(record, record.heard_ns, now_ns, cause, Change.FAILED)
        record.losses, record.lost_ns = before
        return changes

    def cut_off(self, pes: Iterable[str], cause: str, now_ns: int) -> list[HealthChange]:
        """Make these PEs unavailable, because a gateway reports that it no longer hears any of them.

        A PE is LOST if this manager has not heard it for `misses` periods. Any other PE is FAILED: the gateway's report
        may be false and the PE may still drive its outputs, so no other PE may be given these outputs yet.
        """
        changes: list[HealthChange] = []
        for record in map(self._records.__getitem__, pes):
            last = record.heard_ns
            silent = last is not None and now_ns - last >= record.period_ns * record.misses
            changes += self._lose(record, last, now_ns, cause, Change.LOST if silent else Change.FAILED)
        return changes

    def tick(self, now_ns: int) -> list[HealthChange]:
        """Find the PEs that are late or silent at `now_ns`, or whose hold-down is over; gives the changes of health.

        When the start-up window closes, every PE that is still WAITING becomes DOWN, too.
        """
        changes: list[HealthChange] = []
        for record in self._records.values():
            changes += self._tick_one(record, now_ns)
        if self._window_closes_ns is not None and now_ns >= self._window_closes_ns:
            self._window_closes_ns = None
            for record in self._records.values():
                if record.standing is Standing.WAITING:
                    record.move(StandingEvent.WINDOW_CLOSES)
                    cause = record.cause = "not heard in the start-up window"
                    changes.append(HealthChange(record.name, Change.ABSENT, cause, None))
        return changes

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) at which to call `tick`; None: no call is needed."""
        due_ns = NEVER_NS if self._window_closes_ns is None else self._window_closes_ns
        for record in self._records.values():
            match record.standing:
                case Standing.UP:
                    record_ns = record.suspect_ns()
                case Standing.SUSPECT:
                    record_ns = record.declare_ns()
                case Standing.WAITING if record.awaited_again:
                    record_ns = record.fallen_silent_ns()
                case Standing.RETURNING if record.receive_failed_since_ns is None:
                    record_ns = min(record.declare_ns(), record.returning_since_ns + record.hold_down_ns())
                case Standing.RETURNING:
                    record_ns = record.declare_ns()
                case _:
                    continue
            due_ns = min(due_ns, record_ns)
        return None if due_ns == NEVER_NS else due_ns

    def _tick_one(self, record: _Record, now_ns: int) -> list[HealthChange]:
        last = record.heard_ns
        if record.standing is Standing.WAITING and record.awaited_again and now_ns >= record.fallen_silent_ns():
            record.move(StandingEvent.SILENT)
            record.cause = "not heard any more, before it could be believed"
            self._close_window_if_all_heard()
            return [HealthChange(record.name, Change.ABSENT, record.cause, last)]
        if record.standing is Standing.UP and now_ns >= record.suspect_ns():
            record.move(StandingEvent.LATE)
            return [HealthChange(record.name, Change.SUSPECTED, "a heartbeat period was missed", last)]
        if record.standing is Standing.SUSPECT and now_ns >= record.declare_ns():
            return self._lose(
                record, last, now_ns, f"silent for {record.misses} heartbeat periods", event=StandingEvent.SILENT
            )
        if record.standing is Standing.RETURNING:
            if now_ns >= record.declare_ns():
                record.move(StandingEvent.SILENT)
            elif not record.is_held_down(now_ns):
                return [self._join(record, now_ns, StandingEvent.HOLD_DOWN_ENDS, "back, and its hold-down is over")]
        return []

    def _join(self, record: _Record, now_ns: int, event: StandingEvent, why: str) -> HealthChange:
        record.move(event)
        record.joined_ns, record.cause = now_ns, None
        return HealthChange(record.name, Change.JOINED, why, record.heard_ns)

    def _lose(
        self,
        record: _Record,
        last_ns: int | None,
        now_ns: int,
        cause: str,
        change: Change = Change.LOST,
        *,
        event: StandingEvent = StandingEvent.FAILED,
    ) -> list[HealthChange]:
        available = record.standing in (Standing.UP, Standing.SUSPECT)
        if available:
            forgiven = now_ns - record.joined_ns >= FORGIVEN_AFTER_NS
            record.losses, record.lost_ns = 1 if forgiven else record.losses + 1, now_ns
            record.cause = cause
        record.move(event)
        self._close_window_if_all_heard()
        return [HealthChange(record.name, change, cause, last_ns)] if available else []

    def _close_window_if_all_heard(self) -> None:
        if all(r.standing is not Standing.WAITING for r in self._records.values()):
            self._window_closes_ns = None
