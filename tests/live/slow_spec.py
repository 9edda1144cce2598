"""A shipped spec for a slow computer: what is shown there is function, not speed."""

from pathlib import Path

import yaml

from heronry_dg.shipped import shipped_spec_path

SLOW_SCENARIO = "tests/scenarios/a_slow_computer_takes_over_from_another.scenario"
"""Flown by the simulator, on a software bus and on a vcan."""


def slow_spec(name: str, folder: Path, *, heartbeat_ms: int, rates_divided_by: int) -> Path:
    """Write a shipped spec with slower heartbeats and lower rates, one process a PE, no phase that begins by itself."""
    document = yaml.safe_load(shipped_spec_path(name).read_text())
    for bus in document["buses"].values():
        bus |= {"heartbeat_ms": heartbeat_ms, "misses": 4}
    for module in document["modules"].values():
        module["partition"] = "all"  # one process a PE: each takes seconds to start there
        for mode in module.get("modes", {"only": module}).values():
            mode["rate_hz"] = max(1, mode["rate_hz"] // rates_divided_by)
    for phase in document.get("phases", {}).values():
        phase.pop("when", None)  # the flight is not slowed down: it would change phase when the show happens to end
    file = folder / f"{name}.dg.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file
