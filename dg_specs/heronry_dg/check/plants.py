"""DG233 and DG245: plants that nothing can control, whatever runs.

A plant is on a control path if a loop leads through the plant and through a module. Such a loop comes to the plant from
an actuator that moves the plant, or from another plant that affects it. It leaves the plant by a sensor that sees the
plant, or by another plant that the plant affects. The check assumes that every module runs in all its modes at once,
and that each input is wired to everything that it accepts. If even then there is no loop, no plan can give one.
heronry_pcs assesses the loops of a plan.
"""

from collections import defaultdict

from heronry_dg.check.subject import Subject
from heronry_dg.cycles import components
from heronry_dg.findings import Findings, listed
from heronry_dg.model import Plant, Spec
from heronry_dg.rules import graph as rules

_RULES = {"A": rules.NO_LOOP, "B": rules.NO_LOOP, "C": rules.LESSER_WITHOUT_LOOP, "D": rules.LESSER_WITHOUT_LOOP}

_Node = tuple[str, str]  # kind, name


def check_plants(subject: Subject, findings: Findings) -> None:
    """Find plants of class A to D that no wiring puts on a control path."""
    spec = subject.spec
    if all(plant.criticality not in _RULES for plant in spec.plants.values()):
        return
    on_path = _on_path(spec)
    for plant in spec.plants.values():
        if plant.criticality in _RULES and plant.name not in on_path:
            sentence = f"no wiring puts plant '{plant.name}' (class {plant.criticality}) on a control path"
            findings.add(_RULES[plant.criticality], subject.place("plants", plant.name), sentence, _why(plant))


def _why(plant: Plant) -> str:
    lacking = [key for key in ("moved_by", "seen_by") if not getattr(plant, key)]
    if lacking and not plant.affects:
        return f"it has no {listed(lacking)}"
    return "no way leads from a sensor that sees the plant to an actuator that moves it"


def _on_path(spec: Spec) -> set[str]:
    found: set[str] = set()
    for loop in components(_possible(spec)):
        plants = {name for kind, name in loop if kind == "plant"}
        if len(plants) < len(loop):
            found |= plants
    return found


def _possible(spec: Spec) -> dict[_Node, list[_Node]]:
    """Return, for each module, device and plant, the modules, devices and plants that it could act on directly."""
    leads: dict[_Node, list[_Node]] = {
        **{("module", name): [] for name in spec.modules},
        **{("device", name): [] for name in spec.devices},
        **{("plant", name): [("plant", other) for other in plant.affects] for name, plant in spec.plants.items()},
    }
    givers: dict[tuple[str, int], dict[_Node, None]] = defaultdict(dict)
    for module in spec.modules.values():
        for mode in module.modes.values():
            for datum in mode.gives.items():
                givers[datum]["module", module.name] = None
    for module in spec.modules.values():
        here = ("module", module.name)
        for leaf in {leaf: None for mode in module.modes.values() for _, leaf in mode.leaves()}:
            for version in range(leaf.best, leaf.worst + 1):
                for giver in givers.get((leaf.variable, version), ()):
                    leads[giver].append(here)
        if module.device is not None:
            device = ("device", module.device)
            start, end = (device, here) if spec.devices[module.device].kind == "sensor" else (here, device)
            leads[start].append(end)
    for plant in spec.plants.values():
        for actuator in plant.moved_by:
            leads["device", actuator].append(("plant", plant.name))
        leads["plant", plant.name] += [("device", sensor) for sensor in plant.seen_by]
    return leads
