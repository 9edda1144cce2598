"""Which priorities the modules of this PE request for functions.

If a function has a `priority_range` in the spec, a module may request another priority for it, and later the priority
of the spec again. A module that repeats its request in the next step makes no new request. If several modules request a
priority of one function, the last request counts. A request *stands* until another one for the function replaces it, or
its module stops.

`faults` repeats a request until the manager acknowledges it, so a lost, late or doubled frame has no effect. The
manager executes at most one requested change a second. Until the second is over it does not acknowledge the next
request, which stays pending here; a newer request for the function replaces a pending one.

A request outside the spec's range is sent as well; the manager refuses the request, and reports the refusal. When a new
term begins, the PE sends its standing requests again. Each request keeps its number, so that no manager executes it
twice. A restart of the PE drops its requests; the manager keeps the priorities.
"""

from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.reports import Faults
from heronry_wire.frame import Frame


class PriorityRequests:
    """Makes the priority requests of the modules of one PE."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._requested: dict[int, dict[int, int]] = {}  # by module: by function, the priority requested last
        self._standing: dict[int, int] = {}  # by function: the module whose request is the last one

    def requested(self, module: int, function: int, priority: int, now_ns: int) -> list[Frame]:
        """Request a priority of a function for a module; returns the frames to send.

        Returns no frames if the module's last request for this function was for the same priority.
        """
        wanted = self._requested.setdefault(module, {})
        if wanted.get(function) == priority:
            return []
        wanted[function] = priority
        self._standing[function] = module
        return self._faults.request_priority(function, priority, now_ns)

    def carry_over(self, carried: CarriedOver) -> None:
        """Keep the requests of modules that go on for functions that another table has, too."""
        functions = carried.functions
        self._requested = {
            module: {functions[function]: priority for function, priority in of.items() if function in functions}
            for module, of in carried.by_module(self._requested).items()
        }
        self._standing = {
            functions[function]: carried.modules[module]
            for function, module in self._standing.items()
            if function in functions and module in carried.modules
        }

    def stopped(self, module: int) -> None:
        """Withdraw the requests of a module that stops."""
        self._requested.pop(module, None)
        for function in [function for function, owner in self._standing.items() if owner == module]:
            del self._standing[function]
            self._faults.withdraw_priority(function)

    def new_mastership(self, now_ns: int) -> list[Frame]:
        """Return the frames that send the standing requests once more, because a new term has begun.

        Requests that are not acknowledged yet are left out, since `faults` repeats them anyway.
        """
        return [frame for function in self._standing for frame in self._faults.repeat_priority(function, now_ns)]
