"""The table from each kind of fault to the function that injects it.

`faults.fault` describes the kinds. To add a kind, add it to `faults.fault`, and write its function in the file of this
folder for its kind of target.
"""

from collections.abc import Mapping

from heronry_tools.sim.flight.injection.attackers import BY_ATTACKERS
from heronry_tools.sim.flight.injection.buses import ON_BUSES
from heronry_tools.sim.flight.injection.inject import Inject
from heronry_tools.sim.flight.injection.managers import ON_MANAGERS
from heronry_tools.sim.flight.injection.modules_and_devices import ON_MODULES_AND_DEVICES
from heronry_tools.sim.flight.injection.orders import BY_OPERATOR
from heronry_tools.sim.flight.injection.pes import ON_PES

INJECTIONS_BY_KIND: Mapping[str, Inject] = {
    **ON_PES,
    **ON_MANAGERS,
    **ON_BUSES,
    **ON_MODULES_AND_DEVICES,
    **BY_ATTACKERS,
    **BY_OPERATOR,
}
