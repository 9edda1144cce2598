"""Every kind of fault, by its name, and how it strikes; what it is, and what is promised, says `faults.fault`.

To add one: name it there, and write how it strikes in the file here of what it hits.
"""

from collections.abc import Mapping

from heronry_tools.sim.flight.injection.attackers import BY_ATTACKERS
from heronry_tools.sim.flight.injection.buses import ON_BUSES
from heronry_tools.sim.flight.injection.inject import Inject
from heronry_tools.sim.flight.injection.managers import ON_MANAGERS
from heronry_tools.sim.flight.injection.modules_and_devices import ON_MODULES_AND_DEVICES
from heronry_tools.sim.flight.injection.orders import BY_OPERATOR
from heronry_tools.sim.flight.injection.pes import ON_PES

STRIKES: Mapping[str, Inject] = {
    **ON_PES,
    **ON_MANAGERS,
    **ON_BUSES,
    **ON_MODULES_AND_DEVICES,
    **BY_ATTACKERS,
    **BY_OPERATOR,
}
