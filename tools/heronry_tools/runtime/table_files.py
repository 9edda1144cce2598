"""The tables of PEs as files: compiled from a spec, each with as many of the contingencies as fit."""

from collections.abc import Iterable
from pathlib import Path

from heronry_dg.model import Spec
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.core.tables import Compiler, PeTables, on_board


def write_tables(spec: Spec, pes: Iterable[str], folder: Path, made: Contingencies | None = None) -> dict[str, Path]:
    """Write one table per PE into a folder, which is made if needed; returns the path of each PE's file.

    made: the contingencies; each table gets as many of them as the PE has room for. None: no contingencies.
    """
    folder.mkdir(parents=True, exist_ok=True)
    texts = table_texts(spec, pes, made)
    files = {pe: folder / f"{pe}.table" for pe in texts}
    for pe, file in files.items():
        file.write_text(texts[pe] + "\n")
    return files


def table_texts(spec: Spec, pes: Iterable[str], made: Contingencies | None) -> dict[str, str]:
    """Compile the tables of these PEs, and return the text of each table by PE.

    made: the contingencies; each table gets as many of them as the PE has room for. None: no contingencies.
    """
    tables = PeTables(Compiler(spec), [] if made is None else on_board(spec, made))
    return {pe: tables.text(pe) for pe in pes}
