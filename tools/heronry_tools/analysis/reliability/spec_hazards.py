"""How likely the elements of a spec fail, as the spec says it."""

from typing import Any

from heronry_dg.model import Spec
from heronry_dg.situation import elements
from heronry_tools.analysis.reliability.chances import CommonCause, Hazards


def hazards(spec: Spec) -> Hazards:
    """Give the rates, probabilities on demand and common causes of a spec's elements."""
    rates, demands = dict[str, float](), dict[str, float]()
    for element in elements(spec):
        kind, _, name = element.partition(":")
        if kind == "channel":
            continue  # the spec says this of whole buses
        its: Any = {"pe": spec.pes, "device": spec.devices, "module": spec.modules, "bus": spec.buses}[kind][name]
        if its.rate_per_h is not None:
            rates[element] = float(its.rate_per_h)
        elif getattr(its, "probability", None) is not None:
            demands[element] = float(its.probability)
    common = tuple(CommonCause(one.elements, float(one.beta)) for one in getattr(spec, "common_cause", ()))
    return Hazards(rates, demands, common)


def mission_hours(spec: Spec) -> float:
    """Give the length of the mission in hours; 1 if the spec does not say it."""
    hours = getattr(spec, "mission_h", None)
    return 1.0 if hours is None else float(hours)
