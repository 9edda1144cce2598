"""Who may still be driving what: the manager's half of "break before make" (rule 6).

A *token* is a thing that must never have two drivers: a DEMUX (`demux:NAME`), or the identifiers of a module that may
run on several PEs (`module:NAME`). A PE *holds* a token when a configuration that it may be running places it there:

    gains    the ones of a configuration, from the first ACTIVATE of its epoch on
    keeps    only those, once it has reported that epoch (it is BROKEN or further)
    loses    all of them as a new incarnation; those of modules once it is declared down; those of a DEMUX
             T_lease after the last ALIVE that named it: by then it has stopped by itself

What is not known: whether a silent PE is dead or cut off. That is why a DEMUX waits.
"""

from collections.abc import Iterable, Mapping

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import hosts_when_all_is_up


class Exclusion:
    """Tokens held by each PE, as far as the manager can know."""

    def __init__(self, spec: Spec, lease_ns: int) -> None:
        """`lease_ns` is T_lease: how long a PE may drive without hearing anybody."""
        self._spec = spec
        self._lease_ns = lease_ns
        self._holds: dict[str, set[str]] = {pe: set() for pe in spec.pes}
        self._last_named_ns: dict[str, int] = {}
        self._movable = {m.name for m in spec.modules.values() if len(hosts_when_all_is_up(spec, m)) > 1}
        self._demux_of = {branch: demux.name for demux in spec.demuxes.values() for branch in demux.branches}

    def tokens(self, configuration: Configuration) -> dict[str, set[str]]:
        """Tokens that a configuration places on each PE."""
        placed: dict[str, set[str]] = {pe: set() for pe in self._spec.pes}
        for name, running in configuration.modules.items():
            if name in self._demux_of:
                placed[running.pe].add(f"demux:{self._demux_of[name]}:{name}")
            if name in self._movable:
                placed[running.pe].add(f"module:{name}")
        return placed

    def named(self, pes: Iterable[str], now_ns: int) -> None:
        """ALIVE has just named these PEs."""
        for pe in pes:
            self._last_named_ns[pe] = now_ns

    def activated(self, placed: Mapping[str, set[str]]) -> None:
        """The first ACTIVATE of a configuration with these tokens is about to go out."""
        for pe, tokens in placed.items():
            self._holds[pe] |= tokens

    def reported(self, pe: str, placed: Mapping[str, set[str]]) -> None:
        """A PE has reported the epoch of these tokens: it has stopped everything else."""
        self._holds[pe] = set(placed[pe])

    def rebooted(self, pe: str) -> None:
        """A PE returned as a new incarnation, or says that it runs nothing."""
        self._holds[pe] = set()

    def declared_down(self, pe: str) -> None:
        """A PE was declared down: the identifiers of its modules are free."""
        self._holds[pe] = {token for token in self._holds[pe] if token.startswith("demux:")}

    def must_break(self, placed: Mapping[str, set[str]], counted_on: Iterable[str]) -> set[str]:
        """PEs counted on that must report `broken` before anybody starts what is new in this configuration."""
        return {pe for pe in counted_on if self._rivals(pe, placed)}

    def held_until_ns(self, placed: Mapping[str, set[str]], counted_on: Iterable[str], now_ns: int) -> int | None:
        """When the last silent PE has certainly stopped driving a DEMUX placed elsewhere; None if none does."""
        ends = []
        for pe in self._holds.keys() - set(counted_on):
            until_ns = self._last_named_ns.get(pe, now_ns) + self._lease_ns
            if until_ns <= now_ns:
                self._holds[pe] = set()
            elif self._rivals(pe, placed):
                ends.append(until_ns)
        return max(ends, default=None)

    def _rivals(self, pe: str, placed: Mapping[str, set[str]]) -> set[str]:
        """Tokens that `pe` holds and must give up because this configuration has a holder on another PE."""
        mine = placed[pe]
        others = {_exclusive_thing(token) for other, tokens in placed.items() for token in tokens if other != pe}
        return {token for token in self._holds[pe] - mine if _exclusive_thing(token) in others}


def _exclusive_thing(token: str) -> str:
    """`demux:NAME:BRANCH` and `demux:NAME:OTHER` are rivals for `demux:NAME`."""
    kind, name = token.split(":")[:2]
    return f"{kind}:{name}"
