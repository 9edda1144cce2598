"""Settings for all tests: a hypothesis example has no time limit, since benchmarks measure speed."""

import gc
from pathlib import Path

import pytest
from hypothesis import settings

from thoroughness import part_of

settings.register_profile("untimed", settings.default, deadline=None, max_examples=part_of(100))
settings.load_profile("untimed")

# Markers that few files have: a run that selects one of them alone imports no other file.
_RARE = ("live", "timing", "vcan")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that do not name the selected marker: to import them all takes a user-mode Linux a minute."""
    marker = config.getoption("markexpr").split(" ")[0]
    if marker in _RARE and collection_path.name.startswith("test_") and collection_path.suffix == ".py":
        return f"pytest.mark.{marker}" not in collection_path.read_text(encoding="utf-8") or None
    return None


def pytest_collection_finish() -> None:
    """Exempt from garbage collection what the run has until its end: thousands of tests, and what they import."""
    gc.collect()
    gc.freeze()
