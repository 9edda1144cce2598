"""Which PE may still drive what: the manager's half of "break before make" (protocol rule 6).

Three kinds of things must never have two drivers:

    demux:NAME       the branches of a DEMUX
    demux:NAME.to    the ends of a DEMUX, as its `to` names them
    module:NAME      the identifiers of a module that may run on several PEs

A *token* stands for such a thing on one PE; the token of a DEMUX also names the module that runs there. A PE *holds* a
token when a configuration that the PE may be running places the token there.

A PE gains:

- the tokens of a configuration, at the first ACTIVATE of its epoch;
- every token that could be placed on the PE, if it is found running another manager's configuration, or if this manager
  has not heard the PE when the mastership begins.

When a PE has reported an epoch (it is BROKEN or further), it keeps only the tokens of that epoch and of newer epochs.
The PE may take up a newer epoch without a further report.

A PE loses:

- all tokens, if it is available and turns out to be a new incarnation, or to run nothing any more;
- the tokens of modules, if the PE was declared down for its silence, and the silence has lasted for three and a quarter
  heartbeat periods of the slowest bus on the way to the PE;
- all tokens, T_lease after the first ALIVE on the bus that does not name the PE. A PE that hears this ALIVE stops
  immediately. A PE that does not hear it is cut off, and stops by itself T_lease after it last heard another node.

*Three periods and a quarter.* After the last frame that a PE has heard from another node, the PE goes on sending a
module's frames for two periods. It may have heard that frame up to a period after it sent its own last state. So the PE
may send for three periods after its last state. A gateway goes on forwarding the module's frames by the same rule, and
its period may be longer. Therefore the period of the slowest bus on the way counts. A PE may be declared down after
fewer silent periods, namely after `misses` of its bus. Even then it holds the tokens of modules until three periods and
a quarter are over.

*Pauses.* The time of the silence and T_lease count only while this manager runs. The manager has a beat in every
heartbeat period. So if two of its steps are further apart, it was paused or its clock has jumped, and it cannot tell
which. After a jump no time may have passed at all, so no part of such a gap counts. A shorter gap always counts.

*Lost frames and restarts.* If the manager misses a state, no token becomes free. A PE that misses frames stops earlier
than the manager assumes. A late or doubled page 0 has no effect (`deployment`). A manager that restarts knows no
tokens. For each PE that this manager does not hear, T_lease counts from the first ALIVE of this manager.

docs/protocol/exclusion.md tells the PE's half, and why T_lease must pass.
"""

from collections.abc import Collection, Iterable, Mapping

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import hosts_when_all_is_up
from heronry_manager.core.topology import command_period_ns, uplink_bus
from heronry_wire.protocol_times import t_lease_ns, unsent_ns


class Exclusion:
    """Keeps the tokens that each PE holds, as far as the manager can know."""

    def __init__(self, spec: Spec, *, tells_departures: bool = False) -> None:
        """Begin without tokens.

        tells_departures: the driver reports by `said` when an ALIVE is on the bus. If False, `named` has the effect of
            `said`, too.
        """
        self._spec, self._tells_departures = spec, tells_departures
        self._lease_ns = {
            pe: t_lease_ns(spec.buses[uplink_bus(spec, pe)].heartbeat_ns) for pe in spec.pes
        }  # T_lease of each, as the PE itself counts it: five periods of the bus on which it reports
        self._unsent_after_ns = {pe: unsent_ns(command_period_ns(spec, pe)) for pe in spec.pes}
        self._movable = {m.name for m in spec.modules.values() if len(hosts_when_all_is_up(spec, m)) > 1}
        self._things = spec.exclusive_things()
        self.forget()
        self._possible: dict[str, set[str]] = {pe: set() for pe in spec.pes}
        for module in spec.modules.values():
            for pe in hosts_when_all_is_up(spec, module):
                self._possible[pe] |= self._tokens_of(module.name)

    def forget(self) -> None:
        """Forget which PE may hold which token, and what ALIVE has said."""
        pes = self._spec.pes
        self._holds: dict[str, set[str]] = {pe: set() for pe in pes}
        self._named: frozenset[str] = frozenset()  # PEs in the last ALIVE
        self._last_named_ns: dict[str, int] = {}  # when each PE was named last, or left out first
        self._unsaid: set[str] = set()  # PEs that no ALIVE on the bus has left out yet
        self._slept_ns = dict.fromkeys(pes, 0)  # pauses of this manager since each PE was heard last
        self._unsent_ns: dict[str, int] = {}  # when a PE that was declared down has certainly stopped sending

    def tokens(self, configuration: Configuration) -> dict[str, set[str]]:
        """Return the tokens that a configuration places on each PE: what must not have a second driver."""
        placed: dict[str, set[str]] = {pe: set() for pe in self._spec.pes}
        for name, running in configuration.modules.items():
            placed[running.pe] |= self._tokens_of(name)
        return placed

    def _tokens_of(self, module: str) -> set[str]:
        tokens = {f"demux:{thing}:{module}" for thing in self._things.get(module, ())}
        if module in self._movable:
            tokens.add(f"module:{module}")
        return tokens

    def begun(self, now_ns: int, available: Collection[str]) -> None:
        """Begin a mastership: a PE that is not in `available` holds every token that could be placed on it.

        An ALIVE of the previous manager may have named any PE. So for every PE, `now_ns` counts as the time at
        which an ALIVE named it last.
        """
        self._last_named_ns = dict.fromkeys(self._spec.pes, now_ns)
        self._unsaid = set(self._spec.pes) if self._tells_departures else set()
        for pe in self._spec.pes.keys() - set(available):
            self.unknown(pe)

    def named(self, pes: Collection[str], now_ns: int) -> None:
        """Note that an ALIVE which is about to go out names these PEs, and no others."""
        if self._tells_departures:
            self._unsaid |= self._named
        self._unsaid.difference_update(pes)
        for pe in self._named.union(pes):
            self._last_named_ns[pe] = now_ns
        for pe in pes:
            self._unsent_ns.pop(pe, None)
        self._named = frozenset(pes)

    @property
    def waits(self) -> bool:
        """Tell whether `said` must be called when the next ALIVE is on the bus, since it names one PE less."""
        return bool(self._unsaid)

    def said(self, pes: Collection[str], now_ns: int) -> None:
        """Note that an ALIVE which names these PEs, and no others, is on the bus."""
        for pe in self._unsaid.difference(pes):
            self._last_named_ns[pe] = now_ns
        self._unsaid.intersection_update(pes)

    def heard(self, pe: str) -> None:
        """Note that a PE was heard; if the PE is declared down later, its silence counts from now on."""
        self._slept_ns[pe] = 0

    def slept(self, unknown_ns: int) -> None:
        """Let `unknown_ns` nanoseconds count neither for the silence of a PE nor for T_lease.

        In this time this manager did not run, or its clock jumped.
        """
        self._slept_ns = {pe: slept_ns + unknown_ns for pe, slept_ns in self._slept_ns.items()}
        self._last_named_ns = {pe: at_ns + unknown_ns for pe, at_ns in self._last_named_ns.items()}
        self._unsent_ns = {pe: at_ns + unknown_ns for pe, at_ns in self._unsent_ns.items()}

    def activated(self, placed: Mapping[str, set[str]]) -> None:
        """Give each PE the tokens of a configuration in addition to its own, before the first ACTIVATE goes out."""
        for pe, tokens in placed.items():
            self._holds[pe] |= tokens

    def reported(self, pe: str, *placed: Mapping[str, set[str]]) -> None:
        """Record that a PE holds exactly the tokens that `placed` gives to it.

        placed: tokens by PE, for the epoch that the PE reports and for each newer epoch that the PE may take up.
        """
        self._holds[pe] = set[str]().union(*(tokens[pe] for tokens in placed))

    def rebooted(self, pe: str) -> None:
        """Record that a PE holds no token: it is available, and has restarted or runs nothing any more."""
        self._holds[pe] = set()

    def declared_down(self, pe: str, heard_ns: int) -> None:
        """Note that a PE was declared down for its silence since `heard_ns` (head: when it sends no more)."""
        self._unsent_ns[pe] = heard_ns + self._slept_ns[pe] + self._unsent_after_ns[pe]

    def unknown(self, pe: str) -> None:
        """Record that a PE may hold every token that it could get, since it may run another manager's configuration."""
        self._holds[pe] |= self._possible[pe]

    def must_break(self, placed: Mapping[str, set[str]], available: Iterable[str]) -> set[str]:
        """Return the available PEs that must report BROKEN, since `placed` gives a token of theirs to another PE."""
        return {pe for pe in available if self._rivals(pe, placed)}

    def demux_free_ns(self, placed: Mapping[str, set[str]], available: Iterable[str], now_ns: int) -> int | None:
        """Return when (ns) unavailable PEs have certainly stopped driving DEMUXes that `placed` moves; None: now."""
        return self._free_ns(placed, available, now_ns, demux=True)

    def identifiers_free_ns(self, placed: Mapping[str, set[str]], available: Iterable[str], now_ns: int) -> int | None:
        """Return when (ns) unavailable PEs certainly stop sending for modules that `placed` moves; None: now."""
        return self._free_ns(placed, available, now_ns, demux=False)

    def _free_ns(
        self, placed: Mapping[str, set[str]], available: Iterable[str], now_ns: int, *, demux: bool
    ) -> int | None:
        ends = []
        for pe in self._holds.keys() - set(available):
            since_ns = now_ns if pe in self._unsaid else self._last_named_ns.get(pe, now_ns)
            lease_ends_ns = since_ns + self._lease_ns[pe]
            unsent_ns = self._unsent_ns.get(pe, lease_ends_ns)
            if lease_ends_ns <= now_ns:
                self._holds[pe] = set()
            elif unsent_ns <= now_ns:
                self._holds[pe] = {token for token in self._holds[pe] if _is_demux(token)}
            if any(_is_demux(token) is demux for token in self._rivals(pe, placed)):
                ends.append(lease_ends_ns if demux else min(lease_ends_ns, unsent_ns))
        return max(ends, default=None)

    def _rivals(self, pe: str, placed: Mapping[str, set[str]]) -> set[str]:
        """Return the tokens of a PE whose exclusive thing `placed` gives to another PE, and not to this one as well."""
        mine = placed[pe]
        others = {_exclusive_thing(token) for other, tokens in placed.items() for token in tokens if other != pe}
        return {token for token in self._holds[pe] - mine if _exclusive_thing(token) in others}


def _is_demux(token: str) -> bool:
    return token.startswith("demux:")


def _exclusive_thing(token: str) -> str:
    """Return the thing that a token stands for: `demux:NAME` for `demux:NAME:BRANCH`, and `module:NAME` for itself."""
    kind, name = token.split(":")[:2]
    return f"{kind}:{name}"
