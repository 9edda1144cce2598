"""How likely the elements of a spec fail, as the spec says it."""

from heronry_dg.model import Bus, Device, Module, Pe, Spec
from heronry_dg.situation import elements
from heronry_tools.analysis.reliability.chances import CommonCause, Hazards
from heronry_tools.console.errors import UserError


def hazards(spec: Spec) -> Hazards:
    """Return the rates, probabilities on demand and common causes of a spec's elements.

    Raises UserError for an element with a rate and a probability, and for a common cause that makes no sense.
    """
    rates, demands = dict[str, float](), dict[str, float]()
    for element in elements(spec):
        its = _element(spec, element)
        if its is None:
            continue
        if its.rate_per_h is not None and its.probability is not None:
            raise UserError(f"{spec.name}: {element} has a rate_per_h and a probability; leave one of them out")
        if its.rate_per_h is not None:
            rates[element] = float(its.rate_per_h)
        elif its.probability is not None:
            demands[element] = float(its.probability)
    common = tuple(CommonCause(one.elements, float(one.beta)) for one in spec.common_cause)
    _require_sense(spec, rates, demands, common)
    return Hazards(rates, demands, common)


def _element(spec: Spec, element: str) -> Pe | Device | Module | Bus | None:
    kind, _, name = element.partition(":")
    match kind:
        case "pe":
            return spec.pes[name]
        case "device":
            return spec.devices[name]
        case "module":
            return spec.modules[name]
        case "bus":
            return spec.buses[name]
        case _:
            return None  # a channel: the spec says how likely a whole bus fails


def _require_sense(
    spec: Spec, rates: dict[str, float], demands: dict[str, float], common: tuple[CommonCause, ...]
) -> None:
    shares: dict[str, float] = {}
    for cause in common:
        if not (rates.keys() >= set(cause.elements) or demands.keys() >= set(cause.elements)):
            raise UserError(
                f"{spec.name}: the elements of the common cause {', '.join(cause.elements)} need a rate_per_h each, "
                f"or a probability each; write what is missing"
            )
        for element in cause.elements:
            shares[element] = shares.get(element, 0.0) + cause.beta
            if shares[element] > 1.0 + 1e-12:
                raise UserError(f"{spec.name}: the shares beta of {element} add up to more than 1; lower them")


def mission_hours(spec: Spec) -> float:
    """Return the length of the mission in hours; 1 if the spec does not say it."""
    return 1.0 if spec.mission_h is None else float(spec.mission_h)
