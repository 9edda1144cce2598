"""What faults take out of use, and whether a configuration works without it.

A configuration *uses* the modules it runs, the PEs they run on and the devices they drive. What faults take out of use
is what they name and what follows from it: a dead PE takes its devices along, and a PE without a route to the
manager's bus counts as down.

*It stays the best iff it uses nothing that is lost.* Then it is as legal and as good as before: semantics rules 3 to 6
and 8 concern the configuration alone; capacities do not change; and its frames take the same buses, hence the same
bandwidth and the same response times. Buses and gateways on its routes need no check: each end of a route is in
use, so each still has a way up to the manager's bus; both ways together hold a route between the ends, and in a forest
of buses there is no other than the one there was.

*More faults leave fewer configurations.* Whatever is legal with some elements down is legal, and worth the same, with
fewer of them down: everything above holds in reverse, and nothing gains by a fault. So a plan that is the best with F
down, and uses nothing that is lost with E, is the best with F and E down, too: at all seven levels, as long as level 4
counts against the same running configuration.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, Survivors, survivors


def lost_elements(spec: Spec, now: Situation) -> frozenset[str]:
    """PEs, devices and modules that a situation takes out of use, directly or along with something else."""
    return lost_of(survivors(spec, now))


def lost_of(left: Survivors) -> frozenset[str]:
    """Give the same, where it is known already what is left."""
    spec = left.spec
    pes = (f"pe:{pe}" for pe in spec.pes if pe not in left.pe_cpu_millis)
    devices = (f"device:{device}" for device in spec.devices if device not in left.devices)
    return frozenset((*pes, *devices, *(f"module:{module}" for module in left.failed_modules)))


def used_elements(spec: Spec, configuration: Configuration) -> frozenset[str]:
    """PEs, devices and modules that a configuration cannot do without."""
    used = set[str]()
    for name, running in configuration.modules.items():
        used.update((f"module:{name}", f"pe:{running.pe}"))
        device = spec.modules[name].device
        if device is not None:
            used.add(f"device:{device}")
    return frozenset(used)
