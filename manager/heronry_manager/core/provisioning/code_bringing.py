"""Brings code that a PE lacks, as a bundle in parts, and ends the fault that its lack was (protocol rule 10).

    lacking     a PE has reported that the code of a module is not there; the module's place counts as failed, so plans
                do without it. Of all these, the module of the highest criticality is served first
    asked       which bundle does the PE run (2030h sub 3), and how much of this one has it already (2030h sub 2)?
    sending     one part after the other (2030h sub 1), at the pace that what runs allows
    checking    the PE's loader works on the whole bundle (1F57h); then it is started (1F51h) and checked again
    arrived     the PE runs this bundle: the faults of all modules whose images the bundle holds are cleared on this
                PE, and the planner does the rest
    refused     the PE runs another bundle of this version, or a newer one: nothing is sent. Or it has refused the
                bundle (errors 6 and 7): it is brought it again only after it has restarted, or has reported the lack
                anew, as it does when the operator has cleared the fault
    paused      something has failed, or another SDO client has made a request to the PE. The pause doubles, and what
                the PE has of the bundle is not sent again

*Who may change it.* Only an active manager that may send brings code. What it brings was read from files at its start.
With a key each write follows an UNLOCK, and a report of lacking code counts only if it is proven.

*What may go wrong.* A lost, late or doubled answer ends a step, which is done again after the pause. A forged answer
can make a transfer fail, or clear a fault although the code is not there: the PE then reports the lack anew, before it
stages anything. A PE that restarts has forgotten the last parts, and says how many it has. Code that fails on the PE is
taken back there, and its version is refused from then on: this is told. A restart or takeover of the manager forgets
all this; the PEs report what they lack to each new manager.

A PE has one bundle in use, so two bundles would displace each other. It is brought only a bundle that holds all of its
images that come in bundles; if there is none, this is told.

One PE is served at a time, with a table or with code (`one_served`). Only PEs on the manager's own bus are served. No
decision on what runs depends on anything here but the clearing of those faults.
"""

from collections.abc import Callable
from hashlib import sha256
from typing import Any

from heronry_dg.situation import hosts_when_all_is_up
from heronry_dg.traffic import criticality_ranks
from heronry_manager import events
from heronry_manager.core.epochs import Deployment
from heronry_manager.core.mastership import Claim
from heronry_manager.core.membership import Health
from heronry_manager.core.provisioning.served_pe import FOR_ANOTHER_NS, SHORTEST_PAUSE_NS, ServedPe
from heronry_manager.core.sdo_client import OneServed, Outcome
from heronry_manager.core.settings import CodeBundle, ManagerSettings
from heronry_manager.core.situation import KnownSituation, LatchedFault
from heronry_manager.core.turn import Turn
from heronry_wire.canopen_objects import PROGRAM_CONTROL, PROGRAM_STATUS, PROGRAM_TRANSFER, PROGRAM_VERSION
from heronry_wire.frame import Frame
from heronry_wire.sansio import NEVER_NS

PART_BYTES = 7000
LOOK_NS = 500_000_000
"""How often lacking code is looked for, and how often a loader at work is asked."""

_AFTER_JOINING_NS = 5_000_000_000  # the manager's other questions to a PE that has joined are answered
_MOST_LOOKS = 140  # a loader works for at most 70 s
_START = b"\x01"
_FOR_GOOD = (6, 7)  # of these errors: the same bundle has the same answer until the PE restarts
_ERRORS = {
    3: "it does not take it, or not yet: its log says why",
    5: "its disk does not take it: its log says why",
    6: "it is too large for it: leave files out",
    7: "it is not for this PE (signature, version or Python), or code of it runs: its log says why",
}


class CodeBringing:
    """Brings bundles to PEs that lack code; `next_ns` is the time in ns at which to call `tick`."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        claim: Claim,
        health: Health,
        deployment: Deployment,
        *,
        situation: KnownSituation,
        served: OneServed,
    ) -> None:
        """Begin without a transfer; without `settings.bundles` nothing is ever brought."""
        self._spec, self._bundles = settings.spec, settings.bundles
        self._turn, self._claim, self._health, self._situation = turn, claim, health, situation
        self._client = ServedPe(
            settings, turn, deployment=deployment, situation=situation, served=served, failed=self._not_taken
        )
        here = self._client.may_serve(settings.spec.pes.values() if self._bundles else ())
        self._pes = frozenset(pe.name for pe in here)
        self._ranks = criticality_ranks(settings.spec) if here else {}
        self._look_ns = turn.now_ns if here else NEVER_NS
        self._bundle: CodeBundle | None = None  # that goes to the PE which is served
        self._looks = 0
        self._told: dict[str, str] = {}
        self._refused: dict[str, tuple[int | None, int]] = {}  # by PE: its incarnation when it refused, and the time
        in_bundles = frozenset[str]().union(*(one.images for one in self._bundles))
        self._needs: dict[str, frozenset[str]] = {  # by PE: its images that come in bundles
            pe.name: in_bundles.intersection(
                one.image
                for one in settings.spec.modules.values()
                if pe.name in hosts_when_all_is_up(settings.spec, one)
            )
            for pe in here
        }
        self.clear: Callable[[str], None] = lambda _: None
        """Clears the fault of an element, as an operator does; the manager sets it."""

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return self._client.hears(identifier)

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: there is nothing to bring."""
        return self._look_ns if self._client.pe is None else self._client.next_ns

    def status(self) -> dict[str, str]:
        """Return by PE what is on its way to it, or why it is not."""
        said, pe, bundle = dict(self._told), self._client.pe, self._bundle
        if pe is not None and bundle is not None:
            said[pe] = f"{bundle.name}, version {bundle.version}: {self._client.at} of {len(bundle.content)} bytes"
        return said

    def progress(self) -> dict[str, Any] | None:
        """Return the code that is on its way (`ServedPe.progress`)."""
        return self._client.progress()

    def take(self, frame: Frame) -> None:
        """Process an SDO answer of a PE, or the request of another SDO client to it."""
        another = self._client.asked_by_another(frame)
        if another is None:
            self._client.heard(frame)
        else:
            self._leave(another, FOR_ANOTHER_NS)

    def tick(self) -> None:
        """Do what is due, and look for code that a PE lacks."""
        now_ns, pe = self._turn.now_ns, self._client.pe
        if pe is None:
            if now_ns >= self._look_ns:
                self._look_ns = now_ns + LOOK_NS
                self._begin_next()
        elif self._health.is_available(pe):
            self._client.tick()
        else:
            self._leave(pe, SHORTEST_PAUSE_NS, abort=True)

    def end_of_step(self) -> None:
        """Forget everything if this manager is not active any more; to be called after each event."""
        if not self._claim.is_active and (self._client.pe is not None or self._told):
            self._client.end()
            self._client.forget()
            self._told.clear()
            self._refused.clear()

    # What is lacking

    def _lacking(self) -> list[LatchedFault]:
        """Return the faults that are lacks of code, the most critical module first."""
        found = [one for one in self._situation.lacking_code() if one.by in self._pes]
        return sorted(found, key=lambda one: (self._ranks[_module(one)], one.element))

    def _begin_next(self) -> None:
        now_ns = self._turn.now_ns
        if not self._claim.is_active or self._turn.silent or self._client.is_held():
            return
        lacking = self._lacking()
        for pe in self._told.keys() - {one.by for one in lacking}:
            del self._told[pe]
            self._refused.pop(pe, None)
        for fault in lacking:
            pe = fault.by
            ready_ns = max(self._client.not_before_ns(pe), fault.since_ns + _AFTER_JOINING_NS)
            image = self._spec.modules[_module(fault)].image
            if image in self._needs[pe] and ready_ns <= now_ns and self._may_try(fault):
                bundle = self._bundle_for(self._needs[pe])
                if bundle is None:
                    self._fail(
                        pe, f"no bundle holds all of its code: build one with {', '.join(sorted(self._needs[pe]))}"
                    )
                    continue
                if len(bundle.content) > self._spec.pes[pe].flash:
                    self._fail(
                        pe, f"{bundle.name} has {len(bundle.content)} bytes, more than its flash: leave files out"
                    )
                    continue
                if self._client.begin(pe):
                    self._ask(pe, bundle)
                    return

    def _may_try(self, fault: LatchedFault) -> bool:
        incarnation, refused_ns = self._refused.get(fault.by, (None, -1))
        has_refused = refused_ns >= fault.since_ns and incarnation == self._health.incarnation(fault.by)
        return self._health.is_available(fault.by) and not has_refused

    def _bundle_for(self, images: frozenset[str]) -> CodeBundle | None:
        holding = [one for one in self._bundles if images <= one.images]
        return max(holding, key=lambda one: (len(one.images), one.version), default=None)

    # The steps of a transfer

    def _ask(self, pe: str, bundle: CodeBundle) -> None:
        self._bundle = bundle
        self._client.read(PROGRAM_TRANSFER, 3, lambda digest: self._active(pe, bundle, digest))

    def _active(self, pe: str, bundle: CodeBundle, digest: bytes) -> None:
        if digest == sha256(bundle.content).digest():
            self._arrived(pe, bundle)
        else:
            self._client.read_number(PROGRAM_VERSION, 1, lambda value: self._version(pe, bundle, value))

    def _version(self, pe: str, bundle: CodeBundle, value: int) -> None:
        if value >= bundle.version:
            self._fail(pe, f"it has version {value} of its code: build {bundle.name} with a higher one")
            return

        def start() -> None:
            self._client.write(PROGRAM_CONTROL, _START, lambda: self._await_loader(pe, is_started))

        def is_started() -> None:
            self._client.read(PROGRAM_TRANSFER, 3, lambda digest: self._runs(pe, bundle, digest))

        self._client.bring(PROGRAM_TRANSFER, bundle.content, PART_BYTES, lambda: self._await_loader(pe, start))

    def _await_loader(self, pe: str, then: Callable[[], None]) -> None:
        """Look at the loader until it has done its work; `then` follows if it has done it well."""
        self._looks = 0

        def look(status: int) -> None:
            self._looks += 1
            if status & 1 and self._looks < _MOST_LOOKS:
                look_later()
            elif status:
                if status >> 1 in _FOR_GOOD:
                    self._refused[pe] = self._health.incarnation(pe), self._turn.now_ns
                why = "its loader does not end its work" if status & 1 else f"it gives the error {status >> 1} of 1F57h"
                self._fail(pe, _ERRORS.get(status >> 1, why))
            else:
                then()

        def look_later() -> None:
            self._client.later(LOOK_NS, lambda: self._client.read_number(PROGRAM_STATUS, 1, look))

        look_later()

    def _runs(self, pe: str, bundle: CodeBundle, digest: bytes) -> None:
        if digest == sha256(bundle.content).digest():
            self._arrived(pe, bundle)
        else:
            self._fail(pe, "it has taken the code, and does not use it: its log says why")

    def _arrived(self, pe: str, bundle: CodeBundle) -> None:
        took_ns = self._turn.now_ns - self._client.began_ns
        self._client.end()
        self._told.pop(pe, None)
        self._client.is_well(pe)
        self._client.put_off(pe, SHORTEST_PAUSE_NS)
        name, version, size = bundle.name, bundle.version, len(bundle.content)
        self._turn.emit(events.CodeBrought, pe=pe, bundle=name, version=version, bytes=size, took_ns=took_ns)
        for fault in self._lacking():
            if fault.by == pe and self._spec.modules[_module(fault)].image in bundle.images:
                self.clear(fault.element)

    # The end of a transfer

    def _not_taken(self, pe: str, _: Outcome, why: str) -> None:
        self._fail(pe, why)

    def _fail(self, pe: str, why: str) -> None:
        if self._told.get(pe) != why:
            self._told[pe] = why
            self._turn.emit(events.CodeNotTaken, pe=pe, why=why)
        self._client.pause(pe)
        self._client.end()

    def _leave(self, pe: str, pause_ns: int, *, abort: bool = False) -> None:
        """End the transfer to a PE if there is one; none to it begins for `pause_ns`."""
        self._client.put_off(pe, pause_ns)
        if self._client.pe == pe:
            self._client.end(abort=abort)


def _module(fault: LatchedFault) -> str:
    """Return the module of a fault, without its place."""
    return fault.element.removeprefix("module:").partition("@")[0]
