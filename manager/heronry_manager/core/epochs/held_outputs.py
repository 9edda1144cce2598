"""Which PEs hold their exclusive outputs back, and why, as far as the manager can know (OUTPUT_HELD in page 0).

A PE holds its outputs back for a moment in every reconfiguration. So an event reports a PE only if it has held outputs
back for longer than T_lease. Another event reports when the outputs of this PE are free again. The first event gives
the cause, if the manager's own knowledge of the PE shows it. If not, there are two possible causes:

- the PE has heard no node for longer than T_lease, and waits for the next ALIVE;
- a frame has told the PE of a newer epoch. Without a key any node can send such a frame.

If a state frame is lost, the event comes later. A forged flag leads to a false event, and changes no plan.
"""

from dataclasses import dataclass
from typing import Any

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.epochs.deployment import Deployment
from heronry_manager.core.membership import Health
from heronry_manager.core.topology import uplink_bus
from heronry_manager.core.turn import Turn
from heronry_wire.protocol_times import t_lease_ns
from heronry_wire.state_frames import PeFlags, StatePage0


@dataclass(slots=True)
class _Held:
    since_ns: int
    cause: str = ""
    is_told: bool = False


class HeldOutputs:
    """Finds the PEs that hold exclusive outputs back for longer than T_lease."""

    def __init__(self, spec: Spec, turn: Turn, health: Health, deployment: Deployment) -> None:
        self._turn, self._health, self._deployment = turn, health, deployment
        self._exclusive = spec.exclusive_things().keys()
        self._lease_ns = {pe: t_lease_ns(spec.buses[uplink_bus(spec, pe)].heartbeat_ns) for pe in spec.pes}
        self.forget()

    def forget(self) -> None:
        """Forget what the PEs have reported."""
        self._held: dict[str, _Held] = {}

    def reported(self, pe: str, page: StatePage0) -> None:
        """Note from page 0 whether a PE holds outputs back.

        When the PE has held outputs back for longer than T_lease, an event reports it. When the outputs of this PE are
        free again after that, another event reports it.
        """
        now_ns, held = self._turn.now_ns, self._held.get(pe)
        if PeFlags.OUTPUT_HELD not in page.flags:
            self._held.pop(pe, None)
            if held is not None and held.is_told:
                self._turn.emit(events.OutputsFree, pe=pe, for_ns=now_ns - held.since_ns)
        elif held is None:
            self._held[pe] = _Held(now_ns)
        elif not held.is_told and now_ns - held.since_ns > self._lease_ns[pe]:
            held.is_told, held.cause = True, self._cause(pe, page)
            self._turn.emit(events.OutputsHeld, pe=pe, modules=tuple(self._modules(pe)), cause=held.cause)

    def status(self, pe: str) -> dict[str, Any] | None:
        """Return the modules whose outputs a PE holds back, the cause, and for how long it has done so, in ns.

        None: the PE holds no outputs back, or has not done so for longer than T_lease.
        """
        held = self._held.get(pe)
        if held is None or not held.is_told:
            return None
        return {"modules": self._modules(pe), "why": held.cause, "for_ns": self._turn.now_ns - held.since_ns}

    def _modules(self, pe: str) -> list[str]:
        running = self._deployment.running or {}
        return [name for name, (_, where) in running.items() if where == pe and name in self._exclusive]

    def _cause(self, pe: str, page: StatePage0) -> str:
        current = self._deployment.current
        if PeFlags.HEARS_LEASE not in page.flags:
            return "it hears no LEASE of this manager"
        if not self._health.is_available(pe):
            return "it is not available, so ALIVE does not name it"
        if current is not None and page.epoch != current.epoch:
            return f"it runs epoch {page.epoch}, and epoch {current.epoch} is active"
        return "it heard no node for longer than T_lease, or a frame told it of a newer epoch"
