"""Planning: when a plan is requested, whether its answer is taken, and when it is deployed.

*What is decided.* `replanning` decides what a change of the situation means for the plan; `requests` keeps the one
request that counts, and its causes; `storms` decides when changes come so fast that they are gathered. The states of
the request:

    idle ─► waiting ─► idle            the answer with the number of the request
               └─► again ─► waiting    the planner has failed; until the next plan the running configuration goes on

Which planner answers is not decided here: the planning policy does that (`heronry_manager.planning_policy`).

*Who may change it.* A change of the situation (`intake.reactions`), the answer to the present request, the time after a
failure, and a script of the operator. A manager that stands by requests nothing.

*What may go wrong.*

    lost       A lost answer blocks nothing: the next change of the situation leads to a new request
    late       An answer with an older number is dropped
    doubled    The second answer is dropped
    forged     Answers come from this computer's own planner, and each plan is verified before it is handed over
    restart    Causes and requests are forgotten. The situation is remembered, and the next mastership requests a plan

Desired, commanded and observed stay apart: the plan is desired, `epochs` commands, only states of PEs are observed.
"""

from heronry_manager.core.planning.replanning import Replanning
from heronry_manager.core.planning.requests import PlanRequests

__all__ = ["PlanRequests", "Replanning"]
