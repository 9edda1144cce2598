"""The facts about a spec that a page needs in addition to the snapshot.

These are names to choose from (phases, elements, functions), and details of what the names stand for.
"""

from typing import Any

from heronry_dg.model import Module, Spec
from heronry_dg.situation import elements
from heronry_tools.analysis.diff.elements import expression_text
from heronry_tools.watch.data_samples import has_numbers
from heronry_tools.web.picture import contributing, symbols


def facts(spec: Spec) -> dict[str, Any]:
    """Return the facts about a spec that a web page needs, as plain data."""
    return {
        "name": spec.name,
        "digest": spec.digest,
        "phases": list(spec.phases),
        "elements": list(elements(spec)),
        "pes": {
            pe.name: {"node_id": pe.node_id, "buses": list(pe.buses), "features": sorted(pe.features)}
            for pe in spec.pes.values()
        },
        "buses": {bus.name: {"kind": bus.kind, "bit_rate": bus.bitrate} for bus in spec.buses.values()},
        "devices": {device.name: {"kind": device.kind, "pe": device.pe} for device in spec.devices.values()},
        "variables": {
            variable.name: {
                "versions": variable.versions,
                "unit": variable.unit,
                "has_numbers": has_numbers(variable),
                "given_by": [
                    {"module": module.name, "mode": mode.name, "version": mode.gives[variable.name]}
                    for module, mode in spec.producers(variable.name)
                ],
            }
            for variable in spec.variables.values()
        },
        "demuxes": {
            demux.name: {"needs": expression_text(spec, demux.demand), "branches": list(demux.branches)}
            for demux in spec.demuxes.values()
        },
        "plants": {
            plant.name: {
                "moved_by": list(plant.moved_by),
                "seen_by": list(plant.seen_by),
                "criticality": plant.criticality,
            }
            for plant in spec.plants.values()
        },
        "modules": {module.name: _module(spec, module) for module in spec.modules.values()},
        "functions": {
            function.name: {
                "output": function.output,
                "outputs": list(function.outputs),
                "wanted_in": [phase for phase in (*spec.phases, None) if function.priority_in(phase)],
            }
            for function in spec.functions.values()
        },
        "symbols": symbols(spec),
        "contributing": contributing(spec),
    }


def _module(spec: Spec, module: Module) -> dict[str, Any]:
    return {
        "device": module.device,
        "runs_on": None if module.runs_on is None else list(module.runs_on),
        "image": module.image,
        "modes": [
            {
                "name": mode.name,
                "needs": None if mode.needs is None else expression_text(spec, mode.needs),
                "gives": dict(mode.gives),
            }
            for mode in module.modes.values()
        ],
    }
