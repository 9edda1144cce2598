"""An aircraft reaches a new epoch even if changes come fast.

*Epochs.* If a manager prepares one epoch after the other, it must activate one of them. The oracle reads PREPARE and
ACTIVATE of the active manager. A violation is more than `_IN_A_ROW` epochs that were prepared in a row, over more than
`_STORM_NS`, without an ACTIVATE.

*Requests.* If a manager requests one plan after the other, it must use one of the answers. The oracle sees the
requests, and the answers that each manager is given. A request is *in vain* in two cases:

- The manager makes another request before the answer has come.
- The answer differs from the running configuration, but the manager makes another request at the moment at which it
  gets the answer.

A violation is more than `_IN_A_ROW` requests in vain, one after the other, over more than `_STORM_NS`, without an
ACTIVATE.

Up to these limits epochs and requests may follow each other, since the manager answers each change by a plan for the
newest situation.

Not verified:

- whether the manager was right to abandon a single epoch or request;
- a request that is never answered (`end_state` detects that if a plan was needed).
"""

from dataclasses import dataclass

from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.planning_seen import PlanGiven, PlanningSeen, PlanRequested
from heronry_wire.management import Activate, ManagementMessage, Prepare

_IN_A_ROW = 20
_STORM_NS = 2_000_000_000  # twice the time after which a manager finishes one epoch before the next change


@dataclass(slots=True)
class _Requests:
    """The newest plan request of one manager, and how many requests in a row were *in vain*.

    The head of this file says when a request is in vain.
    """

    in_vain: int = 0
    since_ns: int = 0  # time from which they are counted
    number: int | None = None  # of the present request; None: there was none
    answer: PlanGiven | None = None  # to the present request


class ProgressCheck(Oracle):
    """Counts prepared epochs, and each manager's plan requests *in vain*, since the last ACTIVATE.

    If one of these counts is too high, over too long a time, this is a violation. A plan request is in vain
    in two cases (`_is_in_vain`):

    - The manager makes its next request before the answer to the earlier one has come.
    - The manager makes its next request at the moment at which this answer comes, and the answer differs
      from the running configuration.
    """

    def __init__(self) -> None:
        super().__init__()
        self._epochs: set[int] = set()
        self._since_ns = 0
        self._requests: dict[str, _Requests] = {}  # by station

    def began(self, _t_ns: int) -> None:
        """Forget the prepared epochs and the plan requests that were counted, since a new mastership has begun."""
        self._epochs.clear()
        self._requests.clear()

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Count the epochs prepared since the last ACTIVATE; too many over too long a time are a violation.

        An ACTIVATE sets this count to 0, and also each manager's count of requests in vain
        (`ProgressCheck` says which requests are in vain).
        """
        if isinstance(message, Activate):
            self._epochs.clear()
            self._requests.clear()
        elif isinstance(message, Prepare):
            if not self._epochs:
                self._since_ns = t_ns
            self._epochs.add(message.epoch)
            if self._is_stuck(len(self._epochs), self._since_ns, t_ns):
                self._complain(t_ns, f"{len(self._epochs)} epochs were prepared", "activated", self._since_ns)
                self._epochs.clear()

    def planning(self, seen: PlanningSeen) -> None:
        """Count how many plan requests of a manager, one after the other, were in vain (head of this file).

        If there are too many, over too long a time, record a violation.

        Each request is assessed when the manager makes its next one (`_is_in_vain`). If the request was in vain, the
        count rises by one, otherwise it begins at zero again. Until then the answer to the request is kept.
        """
        requests = self._requests.setdefault(seen.station, _Requests())
        match seen:
            case PlanGiven(request=number):
                requests.answer = seen if number == requests.number else requests.answer
            case PlanRequested(t_ns, _, number):
                if requests.number is not None and _is_in_vain(requests.answer, t_ns):
                    requests.in_vain += 1
                else:
                    requests.in_vain, requests.since_ns = 0, t_ns
                requests.number, requests.answer = number, None
                if self._is_stuck(requests.in_vain, requests.since_ns, t_ns):
                    self._complain(t_ns, f"{requests.in_vain} plans were requested", "used", requests.since_ns)
                    requests.in_vain, requests.since_ns = 0, t_ns

    @staticmethod
    def _is_stuck(count: int, since_ns: int, t_ns: int) -> bool:
        return count > _IN_A_ROW and t_ns - since_ns > _STORM_NS

    def _complain(self, t_ns: int, what: str, done: str, since_ns: int) -> None:
        self.violations.append(Violation(t_ns, "progress", f"{what} in a row, and none was {done}", since_ns))


def _is_in_vain(answer: PlanGiven | None, t_ns: int) -> bool:
    """Tell whether a request was in vain when the next one is made at `t_ns`; None: its answer has not come."""
    return answer is None or (answer.is_new and answer.t_ns == t_ns)
