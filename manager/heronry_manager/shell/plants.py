"""Reports which control paths through the plants of a spec are closed: in an event after each epoch, and in the status.

The core does not use plants. When an epoch runs everywhere or was adopted, and when the status is requested, this file
derives a component graph from the spec and the core's plan (`heronry_pcs`). It changes no plan. For a spec without
plants there is no such event, and no such key in the status.
"""

from typing import Any

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_manager import events
from heronry_pcs.control_paths import control_paths, path_states


class Plants:
    """Reports the states of the control paths through the plants of one spec."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec

    def after(self, told: events.Event, plan: Plan | None) -> events.ControlPaths | None:
        """Return the event on plants that follows the core's event `told`; None if none follows.

        plan: the plan that runs now; None: no plan is known to run.
        """
        if not isinstance(told, events.Reconfigured | events.Adopted) or plan is None or not self._spec.plants:
            return None
        states = path_states(control_paths(self._spec, plan.configuration))
        return events.ControlPaths(told.t_ns, told.epoch, states)

    def status(self, plan: Plan | None) -> dict[str, Any]:
        """Return the part of the status about plants: the state of each control path, and why it is not closed.

        It has the key "plants", and under it the plants by name. It is empty if the spec has no plants, or if
        `plan` is None.

        plan: the plan that runs now; None: no plan is known to run.
        """
        if plan is None or not self._spec.plants:
            return {}
        paths = control_paths(self._spec, plan.configuration)
        return {"plants": {name: {"path": path.state.value, "why": path.why} for name, path in paths.items()}}
