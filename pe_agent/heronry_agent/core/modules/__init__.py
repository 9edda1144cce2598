"""Modules: when each module of this PE is stepped, what becomes of its outputs, and what follows when it fails.

*What is decided.* Every module from its StartModule to its StopModule: that it is due, which data it gets, whether what
it gives may leave this PE, whether it has failed, and whether it starts again.

    running_modules      one module through its life; asks all others here
      schedule             releases at exact multiples of a period, overruns, hangs
      mailboxes            the last datum of each source, and whether it is fresh
      publishing           which frames carry an output; `echo_pace`: how often it is echoed
      failure_texts        why a module failed, in its own words, for people
      rests                which stopped branches have not come to rest
      module_reports       what modules tell the manager
        phase_requests       which mission phase is requested, by a module or by a rule of the spec
        priority_requests    which priority a module requests for a function
        notices              misspelt names, told once a second
    silence_watch        which inputs and outputs are silent
    without_manager      attended ◄─► resting: what stops while no manager is heard

*Who may change it.* `configuration` says which modules start and stop. Answers of the driver move a step on; each
repeats the release to which it belongs. What a module gives is never trusted: it may ask, and report, but neither a
device nor a bus moves without `authority`.

*What may go wrong.*

    lost       A datum that does not come is not fresh after three periods, and then no input
    late       An answer to a step of a module that was stopped meanwhile is dropped. After a pause a module is stepped
               once, and the releases that were missed are counted
    doubled    A doubled datum is the same datum
    forged     A forged datum is taken as a true one, since data have no tag
    restart    No module runs; texts of failures and counts of restarts are gone

The protocol: docs/protocol/faults.md, docs/protocol/phases.md and docs/protocol/priorities.md.
"""

from heronry_agent.core.modules.publishing import ECHO_NODES
from heronry_agent.core.modules.running_modules import RunningModules
from heronry_agent.core.modules.without_manager import WithoutManager

__all__ = ["ECHO_NODES", "RunningModules", "WithoutManager"]
