"""Which elements faults take out of use, and whether a configuration works without them.

A configuration *uses* the modules that it runs, the PEs on which they run (and so their places) and the devices that
they drive. Faults take out of use the elements that they name, and others as a consequence: the devices of a dead PE
are out of use, and a PE without a route to the manager's bus counts as down.

Two facts allow a plan to be kept after further faults.

*A configuration stays legal after faults iff it uses no element that the faults take out of use.* The reasons:

    - Semantics rules 3 to 6 and 8 concern only the configuration.
    - Faults do not change the capacity of what stays in use.
    - The frames of the configuration take the same buses as before. So they need the same bandwidth and have the same
      response times.
    - The buses and gateways on a route need no check. Both PEs at the ends of the route still have a route to the
      manager's bus, so these two routes together join both PEs. The buses form a forest, which has only one route
      between two PEs. So the old route is still there.

*Faults make no configuration legal that was not legal before.* A configuration that is legal with some elements down is
also legal, and has the same value, if fewer elements are down. Suppose that a plan is the best with the faults F, and
uses no element that the faults E take out of use. Then the plan is also the best with F and E together. This holds at
all seven levels of the objective, as long as level 4 compares with the same running configuration. There is one
exception: if E takes a PE out of use to which checkpoints are sent (`receivers`), bandwidth gets free, and with it
another configuration may become legal.
"""

from heronry_dg.checkpoints import kept_modules
from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, Survivors, hosts_when_all_is_up, survivors


def lost_elements(spec: Spec, now: Situation) -> frozenset[str]:
    """PEs, devices, modules and places that are out of use in a situation, directly or as a consequence."""
    return lost_of(survivors(spec, now))


def lost_of(left: Survivors) -> frozenset[str]:
    """Return the result of `lost_elements` for survivors that are already computed."""
    spec = left.spec
    pes = (f"pe:{pe}" for pe in spec.pes if pe not in left.pe_cpu_millis)
    devices = (f"device:{device}" for device in spec.devices if device not in left.devices)
    places = (f"module:{module}@{pe}" for module, pe in left.failed_places)
    return frozenset((*pes, *devices, *(f"module:{module}" for module in left.failed_modules), *places))


def used_elements(spec: Spec, configuration: Configuration) -> frozenset[str]:
    """PEs, devices, modules and places that a configuration uses."""
    used = set[str]()
    for name, running in configuration.modules.items():
        used.update((f"module:{name}", f"module:{name}@{running.pe}", f"pe:{running.pe}"))
        device = spec.modules[name].device
        if device is not None:
            used.add(f"device:{device}")
    return frozenset(used)


def receivers(spec: Spec) -> frozenset[str]:
    """PEs to which the checkpoints of some module may be sent: those of each module that may run on several PEs."""
    homes = (hosts_when_all_is_up(spec, spec.modules[name]) for name in kept_modules(spec))
    return frozenset(f"pe:{pe}" for pes in homes if len(pes) > 1 for pe in pes)
