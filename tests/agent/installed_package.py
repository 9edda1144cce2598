"""A package as pip would have installed it, with entry points of its own: an extension of another maker."""

from pathlib import Path

import pytest


def install(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, code: str, group: str, **entry_points: str
) -> None:
    """Let Python find a package of this name, for as long as a test lasts."""
    (folder / f"{name}.py").write_text(code)
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = (f"{entry} = {target}\n" for entry, target in entry_points.items())
    (metadata / "entry_points.txt").write_text(f"[{group}]\n{''.join(lines)}")
    monkeypatch.syspath_prepend(str(folder))
