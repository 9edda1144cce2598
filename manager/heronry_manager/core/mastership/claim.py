"""Mastership: whether this manager is the active one, stands by, or has ended; and when it begins or gives way.

    LISTENING   the manager sends nothing. There are three reasons for this state:
                1. It has just been started. It listens for T_lease, since a LEASE in that time shows that another
                   manager is active.
                2. It was active, and hears no PE any more: its receiver has failed, or its wire is broken. Its commands
                   could only take outputs away from PEs that hear them. It listens until it hears a PE again, and then
                   for T_lease.
                3. Most PEs refuse its term: they may know of a higher one. A PE shows this by the report that it hears
                   no LEASE. The manager ends its term when most PEs have reported this for T_lease. It listens for
                   T_lease, and begins the next term, which may be high enough. If the next term is refused, too, the
                   manager ends it after twice that time, and so on. After the second refusal in a row it skips many
                   terms, but only once: the higher terms may have been in a journal that was lost
    STARTING    it has a term, and is active: LEASE and ALIVE go out. It waits until every PE was heard, or until the
                start-up window closes
    ACTIVE      it is active, and has requested its first plan: normal operation
    STANDBY     another manager is active. This one follows it (`following`), and takes over when the PEs hear none
    RETIRED     the manager has ended. Another manager is active, and this one was started without `standby`; or all
                terms have been used

A manager gives way in these cases. With `standby` it then stands by; without `standby` it ends:

    - it is LISTENING, and hears another manager
    - it is active, and hears a manager with a higher term
    - it hears a LEASE with its own node-ID and term: a second manager with this node-ID was started by mistake. Of the
      two, the first that hears the other gives way

Manager 127 also stands by for a while if it hears no manager at its start, so that manager 126 goes first
(`following`). So does one that remembers that another spec flies than its own (`flown_spec`). A manager that only
advises the operator (`advice`) sends no frames, so it need not give way.

This file decides; `succession` carries the decision out for the rest of the core. All changes of state are rows of
`MASTERSHIP_TRANSITIONS`. An active manager repeats its LEASE in each period, so a lost LEASE does no harm. A late or
doubled LEASE makes no manager give way twice. A restart begins with LISTENING, and with the terms that the journal
remembers. The manager cannot tell whether another manager is gone, or is merely not heard here. The reports of the PEs
decide that (`following`).
"""

from enum import Enum, auto

from heronry_manager import events
from heronry_manager.core.epochs import NoTermError, next_term
from heronry_manager.core.memory import TermBegun
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.transitions import TransitionTable
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import Stop
from heronry_wire.element_places import spec_mark
from heronry_wire.management import Lease
from heronry_wire.sansio import require

_MOST_DOUBLINGS = 9
_LEAPS_AFTER, _LEAP = 2, 256  # terms that were refused one after the other; terms to skip after them


class Mastership(Enum):
    """States of a manager; the status shows these values."""

    LISTENING = "listening"
    STANDBY = "standby"
    STARTING = "starting"
    ACTIVE = "active"
    RETIRED = "retired"


class MastershipEvent(Enum):
    """Events that change the state of a manager."""

    ENDS = auto()
    STANDS_BY = auto()
    LETS_126_GO_FIRST = auto()
    BEGINS = auto()
    HAS_NO_TERM = auto()
    COMMANDS = auto()
    FALLS_SILENT = auto()


MASTERSHIP_TRANSITIONS = TransitionTable(
    {Mastership.LISTENING: "start"},
    (
        (Mastership.LISTENING, MastershipEvent.ENDS, Mastership.RETIRED, "LEASE of another manager"),
        (
            Mastership.LISTENING,
            MastershipEvent.STANDS_BY,
            Mastership.STANDBY,
            "LEASE of another manager, with --standby",
        ),
        (
            Mastership.LISTENING,
            MastershipEvent.LETS_126_GO_FIRST,
            Mastership.STANDBY,
            "manager 127, with --standby, hears no manager and lets 126 go first",
        ),
        (Mastership.LISTENING, MastershipEvent.BEGINS, Mastership.STARTING, "the manager hears no other"),
        (
            Mastership.STANDBY,
            MastershipEvent.BEGINS,
            Mastership.STARTING,
            "the PEs hear no manager any more, or refuse its term as too low",
        ),
        (Mastership.STARTING, MastershipEvent.HAS_NO_TERM, Mastership.RETIRED, "all terms have been used"),
        (Mastership.STARTING, MastershipEvent.COMMANDS, Mastership.ACTIVE, "all PEs heard, or the window has closed"),
        (Mastership.STARTING, MastershipEvent.ENDS, Mastership.RETIRED, "another manager has precedence"),
        (
            Mastership.STARTING,
            MastershipEvent.STANDS_BY,
            Mastership.STANDBY,
            "another manager has precedence, with --standby",
        ),
        (
            Mastership.ACTIVE,
            MastershipEvent.FALLS_SILENT,
            Mastership.LISTENING,
            "the manager hears no PE any more, or most PEs hear no LEASE",
        ),
        (Mastership.ACTIVE, MastershipEvent.ENDS, Mastership.RETIRED, "another manager has precedence"),
        (
            Mastership.ACTIVE,
            MastershipEvent.STANDS_BY,
            Mastership.STANDBY,
            "another manager has precedence, with --standby",
        ),
    ),
)


class Claim:
    """Decides whether this manager is active, stands by, or ends; keeps its state."""

    def __init__(self, settings: ManagerSettings, turn: Turn) -> None:
        """Begin in the state LISTENING, and listen for the time T_lease from now on."""
        self._settings, self._turn = settings, turn
        self._lease_ns = settings.lease_ns
        self.state = Mastership.LISTENING
        self._last_event: MastershipEvent | None = None
        self.listens_until_ns: int | None = turn.now_ns + self._lease_ns  # None: until a PE is heard, and longer
        own = spec_mark(settings.spec.digest)
        lacks_spec = settings.standby and turn.memory.flies not in (None, own)  # it has followed another one
        self._goes_first = settings.goes_first and not lacks_spec
        self._contradicted: tuple[int, int, int] | None = None  # by which manager and term, and when first
        self._soon_ns = settings.bus.heartbeat_ns // 2
        self._refused_since_ns: int | None = None  # since when most PEs report that they hear no LEASE
        self._refusals = 0  # terms, one after the other, that have ended because most PEs heard no LEASE
        self._has_leapt = False  # only once, or a manager whose transmitter has failed would use up all terms

    @property
    def is_active(self) -> bool:
        """Tell whether this manager is active.

        A manager that only advises sends nothing. It counts as active while it would command if it were allowed to.
        """
        return self.state is Mastership.ACTIVE or self.state is Mastership.STARTING

    def speaks(self) -> bool:
        """Tell whether this manager sends LEASE: it is active, and was not started only to advise (`advise`)."""
        return self.is_active and not self._settings.advise

    def validate(self) -> None:
        """Check the last change of state; raises InvariantError, which lists the recent events."""
        is_listed = MASTERSHIP_TRANSITIONS.may_be(self.state, self._last_event)
        require(is_listed, "{} was reached by {}: {}", self.state, self._last_event, self._turn.recent)

    def _move(self, event: MastershipEvent) -> None:
        self.state, self._last_event = MASTERSHIP_TRANSITIONS.after(self.state, event), event

    # Listening

    def hears_a_pe(self) -> bool:
        """Note a frame of a PE; tells whether this frame ends a silence of all PEs.

        If so, this manager listens for T_lease from now on.
        """
        if self.listens_until_ns is not None:
            return False
        self.listens_until_ns = self._turn.now_ns + self._lease_ns
        return True

    def succeeds(self) -> None:
        """Listen no longer, and let no other manager go first: this manager was active until now, by another spec."""
        self.listens_until_ns, self._goes_first = self._turn.now_ns, True

    def learns_for(self, leases: int) -> None:
        """Listen for `leases` times T_lease from now on, to learn what an active manager announces."""
        self.listens_until_ns = self._turn.now_ns + leases * self._lease_ns

    def may_begin(self) -> bool:
        """Tell whether this manager has listened for long enough, and may now begin a term.

        If it has listened for long enough, but manager 126 is to have the first chance to begin a term, the answer is
        False, and this manager stands by from now on.
        """
        until_ns = self.listens_until_ns
        if self.state is not Mastership.LISTENING or until_ns is None or self._turn.now_ns < until_ns:
            return False
        if not self._goes_first:
            self._move(MastershipEvent.LETS_126_GO_FIRST)
        return self._goes_first

    # Being active

    def begin_term(self) -> bool:
        """Become active in a new term; False: all terms have been used, and this manager ends."""
        self._move(MastershipEvent.BEGINS)
        self._refused_since_ns = None  # no PE has heard this term yet
        leap = _LEAP if self._refusals >= _LEAPS_AFTER and not self._has_leapt else 0
        self._has_leapt = self._has_leapt or leap > 0
        try:
            self._turn.term = next_term(self._settings.node, self._turn.memory.term + leap)
        except NoTermError as error:
            self._end(MastershipEvent.HAS_NO_TERM, str(error))
            return False
        self._turn.keep(TermBegun(self._turn.term))
        return True

    def commands(self) -> bool:
        """Note that the manager requests a plan; tells whether this is the first plan of the present term."""
        is_first = self.state is Mastership.STARTING
        if is_first:
            self._move(MastershipEvent.COMMANDS)
        return is_first

    def is_refused(self, *, most_hear_none: bool) -> bool:
        """Tell whether most PEs have reported for long enough that they hear no LEASE, though this manager sends it.

        "Long enough" is T_lease at first. After each refusal in a row, this time is doubled, up to a limit.

        most_hear_none: most PEs report this now. If False, the refusals so far are forgotten, and the PEs must
            report it for the whole of T_lease again.
        """
        now_ns = self._turn.now_ns
        if not most_hear_none:
            self._refused_since_ns, self._refusals = None, 0
            return False
        since_ns = self._refused_since_ns = now_ns if self._refused_since_ns is None else self._refused_since_ns
        if now_ns - since_ns < self._lease_ns << min(self._refusals, _MOST_DOUBLINGS):
            return False
        self._refused_since_ns, self._refusals = None, self._refusals + 1
        return True

    # Giving way

    def fall_silent(self) -> None:
        """Stop sending, and listen again; the listening ends T_lease after the next frame of a PE.

        After that, this manager begins a term without waiting for manager 126 to begin first.
        """
        self._move(MastershipEvent.FALLS_SILENT)
        self.listens_until_ns, self._goes_first = None, True

    def gives_way_to(self, node: int, lease: Lease) -> bool:
        """Decide on a LEASE of another manager; returns True if this manager gives way and stands by from now on.

        Returns False if this manager need not give way, and wherever the setting `standby` is off. With `standby`
        off this manager ends instead of standing by: at once if it is still listening, otherwise once LEASEs have
        shown that the other manager is active (`_is_contradicted_again`).
        """
        is_listening, term = self.state is Mastership.LISTENING, self._turn.term
        is_double = node == self._settings.node and lease.term == term  # a manager does not receive its own frames
        if not (is_listening or is_double or lease.term > term):
            return False
        if not self._settings.standby:
            if is_listening or self._is_contradicted_again(node, lease.term):
                self._retire(node, lease, is_double=is_double)
            return False
        if not is_listening:
            self._turn.emit(events.SteppedDown, node=node, term=lease.term)
        self._move(MastershipEvent.STANDS_BY)
        return True

    def _is_contradicted_again(self, node: int, term: int) -> bool:
        """Tell whether `node` has sent enough LEASEs with this term to show that it is active.

        With a key one LEASE is enough, since it is proven. Without a key a single LEASE may be recorded or forged. So
        there must be two LEASEs, at least half a heartbeat period and at most T_lease apart.
        """
        now_ns, before = self._turn.now_ns, self._contradicted
        is_same = before is not None and before[:2] == (node, term) and now_ns - before[2] <= self._lease_ns
        if self._settings.key is not None or (before is not None and is_same and now_ns - before[2] >= self._soon_ns):
            return True
        self._contradicted = before if is_same else (node, term, now_ns)
        return False

    def _retire(self, node: int, lease: Lease, *, is_double: bool) -> None:
        bus = self._settings.bus.name
        if self.state is Mastership.LISTENING:
            reason = f"manager {node} is already active on {bus} (term {lease.term})"
        elif is_double:
            reason = f"another manager {node} is active on {bus}, in the same term"
        else:
            reason = f"manager {node} is active with the higher term {lease.term}"
        self._turn.emit(events.SecondManager, node=node, term=lease.term)
        self._end(MastershipEvent.ENDS, reason, "; stop that manager first, or do not start this one")

    def _end(self, event: MastershipEvent, reason: str, remedy: str = "") -> None:
        self._move(event)
        self._turn.emit(events.Stopped, reason=reason)
        self._turn.do(Stop(reason + remedy))
