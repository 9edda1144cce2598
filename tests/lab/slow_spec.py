"""A spec for a slow or busy computer: what is shown there is function, not speed."""

from pathlib import Path
from typing import Any

import yaml

from heronry_tools.console.spec_files import spec_path

SLOW_SCENARIO = "tests/scenarios/a_slow_computer_takes_over_from_another.scenario"
"""Flown by the simulator, on a software bus and on a vcan."""


def slow_spec(spec: str, folder: Path, *, heartbeat_ms: int, rates_divided_by: int | None = None) -> Path:
    """Write a spec with slower heartbeats on every bus; gives the new file.

    spec: a file or a shipped spec.
    rates_divided_by: the modules become slower, too. Then each PE is one process, since a process takes seconds to
    start there, and no phase begins by itself, since the simulated flight is not slowed down. None: they stay.
    """
    document = yaml.safe_load(spec_path(spec).read_text())
    for bus in document["buses"].values():
        bus |= {"heartbeat_ms": heartbeat_ms, "misses": 4}
    if rates_divided_by is not None:
        _slow_down(document, rates_divided_by)
    file = folder / f"{document['name']}.dg.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file


def _slow_down(document: dict[str, dict[str, dict[str, Any]]], rates_divided_by: int) -> None:
    for module in document["modules"].values():
        module["partition"] = "all"
        for mode in module.get("modes", {"only": module}).values():
            mode["rate_hz"] = max(1, mode["rate_hz"] // rates_divided_by)
    for phase in document.get("phases", {}).values():
        phase.pop("when", None)
