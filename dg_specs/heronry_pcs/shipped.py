"""Finds the graphs that are shipped with this package: beside it in a checkout, inside it in an installed wheel."""

from pathlib import Path

from heronry_pcs.graph_files import YAML_SUFFIX

_PACKAGE = Path(__file__).resolve().parent
_FOLDERS = (_PACKAGE.parent / "polymorphic", _PACKAGE / "graphs")


def shipped_graph_names() -> tuple[str, ...]:
    """Names of all shipped graphs, sorted."""
    files = (path for folder in _FOLDERS for path in folder.glob(f"*{YAML_SUFFIX}"))
    return tuple(sorted({path.name.removesuffix(YAML_SUFFIX) for path in files}))


def shipped_graph_path(name: str) -> Path:
    """Return the file of a shipped graph, whose name must be one of `shipped_graph_names`."""
    return next(path for folder in _FOLDERS if (path := folder / f"{name}{YAML_SUFFIX}").is_file())
