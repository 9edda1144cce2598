"""Functions that the best plan of a phase gives up for something more important, though they could be served.

That is no loss as `heronry_tools.analysis.reliability.cut_sets` has it. A further fault may make the more important
function impossible, and then the best plan serves the given-up function again. So if the best plan gives up a function
after some fault set, it need not do so after a larger one. For this reason `given_up` needs a sweep: the best plan of
every fault set.
"""

from collections.abc import Collection, Mapping

from heronry_dg.model import Function
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase
from heronry_tools.analysis.campaign.minimal import minimal


def given_up(
    function: Function,
    cuts: Collection[FaultSet],
    phase: Phase,
    outcomes: Mapping[tuple[Phase, FaultSet], Outcome],
) -> list[FaultSet]:
    """Find the smallest fault sets after which the best plan of a phase leaves out a function that could be served.

    cuts: the resource-aware cut sets of the function.
    """
    sets = [
        down
        for (at, down), outcome in outcomes.items()
        if at == phase
        and not any(output in outcome.configuration.modules for output in function.outputs)
        and not any(cut <= down for cut in cuts)
    ]
    return minimal(sets)
