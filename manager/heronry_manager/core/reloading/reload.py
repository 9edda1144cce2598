"""One change to another spec, from the order of the operator to the last PE.

    idle        nothing is ordered; `given_up` says why the last change was given up
    bringing    the table of the other spec goes to one PE after the other, beside the table that flies (`served_pe`)
    planning    every PE has it; the driver is asked for the first configuration of the other spec (RequestSwitch)
    switching   the epoch of that configuration is on its way (`epochs.spec_switch`)
    done        all PEs fly by the other spec: the driver is told (SpecSwitched), and ends this core. A standby manager
                is told, too (HOLDS of kind SPEC): with a key, the next core is not believed at once

A standby manager is given the other spec beforehand: the spec is *at hand*. When that spec flies (`flown_spec`), the
driver is told (SpecFollowed), and begins a core of it, which stands by. A standby manager that lacks the spec that
flies does not take over, and the status says so; it follows as soon as it is given the spec.

A PE takes a moment to read a table. One that refuses the slice since its table is not there yet is asked again after
AGAIN_NS, up to MOST_TRIES times. While bringing, a PE that is lost ends the change, and so does whatever makes the
manager command another configuration once the epoch is opened.

PEs that are not available take no part. One that has gone silent while it flew may still send what the old spec told it
to; so if an identifier passes to another module, all PEs must be there.
"""

from collections.abc import Mapping
from typing import Any

from heronry_manager.core.epochs import SpecSwitch
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim, Mastership
from heronry_manager.core.provisioning import PART_BYTES, ServedPe
from heronry_manager.core.sdo_client import Outcome
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.tables import CompiledConfiguration
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import ReloadSpec, RequestSwitch, SpecFollowed, SpecSwitched, SwitchReady
from heronry_wire.canopen_objects import CHALLENGE, TABLE_TRANSFER
from heronry_wire.element_places import spec_mark
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command
from heronry_wire.management import Control, ElementKind, Operation
from heronry_wire.sansio import NEVER_NS

AGAIN_NS = 500_000_000
MOST_TRIES = 20
_CERTAINLY_STOPPED_NS = 2_000_000_000
_ALL_NODES = 0


class Reloading:
    """Carries out one change of the spec at a time; `next_ns` is the time in ns at which to call `tick`."""

    def __init__(self, settings: ManagerSettings, turn: Turn, claim: Claim, known: Knowledge) -> None:
        """Begin idle."""
        self._turn, self._claim, self._spec, self._key = turn, claim, settings.spec, settings.key
        self._health, self._deployment, self._situation = known.health, known.deployment, known.situation
        self._script, self._following = known.script, known.following
        self._client = ServedPe(
            settings,
            turn,
            deployment=known.deployment,
            situation=known.situation,
            served=known.served,
            failed=self._not_taken,
        )
        self._client.may_serve(settings.spec.pes.values())
        self._order: ReloadSpec | None = None
        self._lacks: list[str] = []  # PEs to which the table is still to be brought
        self._has: set[str] = set()  # PEs that have it
        self._number = 0  # of the last RequestSwitch
        self._switch: SpecSwitch | None = None
        self._tries = 0
        self._again_ns = NEVER_NS
        self.given_up: str | None = None
        self._at_hand: str | None = None  # digest of the spec that the driver has ready, for a standby manager

    def at_hand(self, digest: str) -> None:
        """Note that the driver has another spec ready, so that a standby manager can follow when it flies."""
        self._at_hand = digest

    def order(self, order: ReloadSpec) -> str | None:
        """Begin a change; returns why it is refused, None: it is on its way."""
        reason = self._why_not(order)
        if reason is not None:
            return reason
        self._order, self.given_up, self._tries, self._switch = order, None, 0, None
        self._has = set()
        self._lacks = [pe for pe in self._health.available() if pe in order.tables]
        self._again_ns = self._turn.now_ns
        return None

    @property
    def is_under_way(self) -> bool:
        """Tell whether an order is being carried out."""
        return self._order is not None

    def status(self) -> dict[str, Any]:
        """Return what the status shows (`manager_status`)."""
        order, other = self._order, self._other_spec()
        shown = {"at_hand": self._at_hand, "flies": None if other is None else f"{other:04x}"}
        if order is None:
            return {"to": None, "state": None, "given_up": self.given_up, **shown}
        brought = len(self._has)
        state = f"{brought} of {brought + len(self._lacks)} PEs have the table" if self._lacks else "the PEs change"
        return {"to": order.digest, "state": state, "given_up": None, **shown}

    def _other_spec(self) -> int | None:
        return self._following.other_spec if self._claim.state is Mastership.STANDBY else None

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return self._order is not None and self._client.hears(identifier)

    def take(self, frame: Frame) -> None:
        """Process an SDO answer of a PE, or the request of another client to the PE that is served."""
        if self._order is None:
            return
        another = self._client.asked_by_another(frame)
        if another is None:
            self._client.heard(frame)
        elif another == self._client.pe:
            self._not_taken(another, Outcome.FAILED, "another SDO client talks to it")

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: nothing waits."""
        return min(self._again_ns, self._client.next_ns if self._client.pe is not None else NEVER_NS)

    def tick(self) -> None:
        """Send what is due."""
        if self._client.pe is not None:
            self._client.tick()
        elif self._turn.now_ns >= self._again_ns:
            self._again_ns = NEVER_NS
            self._go_on()

    def end_of_step(self) -> None:
        """Draw the consequences of what has happened; to be called after each event."""
        if self._at_hand is not None and self._other_spec() == spec_mark(self._at_hand):
            self._at_hand = None
            self._turn.do(SpecFollowed(tuple(self._following.preparation)))
        if self._order is None:
            return
        switch = self._switch
        if not self._claim.is_active:
            self._give_up("the mastership of this manager has ended")
        elif switch is not None and switch.is_done:
            flies = Control(
                self._turn.term, _ALL_NODES, Operation.HOLDS, ElementKind.SPEC, spec_mark(self._order.digest)
            )
            self._order = None
            self._turn.send(Command.CONTROL, flies)
            self._turn.do(SpecSwitched(switch.epoch.epoch, switch.epoch.compiled.digest))
        elif switch is not None and switch.refusal is not None:
            self._refused(switch)
        elif switch is None and (gone := self._gone()) is not None:
            self._give_up(f"pe:{gone} is not available any more")

    def ready(self, answer: SwitchReady) -> None:
        """Open the epoch of the first configuration of the other spec."""
        if self._order is None or answer.number != self._number or self._switch is not None:
            return
        if answer.plan is None:
            self._give_up(answer.problem)
        elif not self._deployment.is_at_rest():
            self._give_up("another configuration was on its way")
        else:
            compiled = CompiledConfiguration(answer.slices, answer.digest, answer.slice_digests)
            self._switch = self._deployment.open_switch(answer.plan, compiled)

    def _why_not(self, order: ReloadSpec) -> str | None:
        deployment = self._deployment
        if self._order is not None:
            return "a change of the spec is under way: see 'heronry status'"
        if self._turn.silent:
            return "this manager only advises: give the order to the active manager"
        if self._script.target is not None:
            return "a script is held: end it with 'heronry release'"
        if not deployment.is_at_rest():
            return "a reconfiguration is under way: give the order again when 'heronry status' shows it done"
        still = sorted(order.leaves & self._used())
        if still:
            return (
                f"the other spec lacks pe:{still[0]}, on which modules run: give 'heronry retire pe:{still[0]}' first"
            )
        return self._why_not_without(order)

    def _used(self) -> set[str]:
        configuration = self._deployment.configuration
        return set() if configuration is None else {running.pe for running in configuration.modules.values()}

    def _why_not_without(self, order: ReloadSpec) -> str | None:
        """Say why there can be no change while some PE is not available; None: there can be one."""
        now_ns, available = self._turn.now_ns, self._health.available()
        for pe in self._spec.pes:
            if pe in available:
                continue
            if order.passes:
                return (
                    f"an identifier passes to another module, and pe:{pe}, which is not available, might still use it"
                )
            if now_ns - self._health.spoke_last_ns(pe) < _CERTAINLY_STOPPED_NS:
                return f"pe:{pe} was lost a moment ago: give the order again"
        return None

    def _gone(self) -> str | None:
        available = self._health.available()
        return next((pe for pe in (*self._lacks, *sorted(self._has)) if pe not in available), None)

    def _go_on(self) -> None:
        """Bring the next table, or request the configuration when every PE has its table."""
        order = self._order
        assert order is not None
        if not self._lacks:
            self._number += 1
            self._switch = None
            self._turn.do(RequestSwitch(self._number, self._situation.now(), self._deployment.running or {}))
        elif self._client.begin(self._lacks[0]):
            self._begin(self._lacks[0], order.tables)
        else:
            self._again_ns = self._turn.now_ns + AGAIN_NS

    def _begin(self, pe: str, tables: Mapping[str, bytes]) -> None:
        key, table = self._key, tables[pe]

        def bring(content: bytes) -> None:
            self._client.bring(TABLE_TRANSFER, content, PART_BYTES, lambda: self._brought(pe))

        if key is None:
            bring(table)
        else:
            self._client.read_number(CHALLENGE, 0, lambda challenge: bring(key.sealed(table, challenge)))

    def _brought(self, pe: str) -> None:
        self._client.end()
        self._lacks.remove(pe)
        self._has.add(pe)
        self._again_ns = self._turn.now_ns

    def _not_taken(self, pe: str, outcome: Outcome, why: str) -> None:
        self._client.end(abort=True)
        self._tries += 1
        if self._tries > MOST_TRIES or (outcome is Outcome.LOCKED and self._key is None):
            keeps = "its agent takes no table while it flies: start it with --node"
            self._give_up(f"pe:{pe} has not taken the table: {keeps if outcome is Outcome.LOCKED else why}")
        else:
            self._again_ns = self._turn.now_ns + AGAIN_NS

    def _refused(self, switch: SpecSwitch) -> None:
        self._tries += 1
        if switch.lacks_table is None or self._tries > MOST_TRIES:
            self._give_up(switch.refusal or "")
        else:  # it still reads the table, or has lost it
            self._switch, self._again_ns = None, self._turn.now_ns + AGAIN_NS
            if self._tries % 4 == 0:
                self._lacks, self._has = [switch.lacks_table], self._has - {switch.lacks_table}

    def _give_up(self, why: str) -> None:
        self._client.end(abort=True)
        self._order, self._switch, self._again_ns, self._lacks = None, None, NEVER_NS, []
        self.given_up = why
