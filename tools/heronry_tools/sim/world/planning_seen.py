"""Reports of a simulated manager's driver on planning: each request, and each answer given to the core."""

from typing import NamedTuple


class PlanRequested(NamedTuple):
    """A manager has requested a plan, under this number; the manager drops answers to its earlier requests."""

    t_ns: int
    station: str
    request: int


class PlanGiven(NamedTuple):
    """A manager is given the answer to its request with the number `request`.

    is_new: the answer is a plan that differs from what ran at the time of the request
    """

    t_ns: int
    station: str
    request: int
    is_new: bool


PlanningSeen = PlanRequested | PlanGiven
