"""No file of the product is too long, and the map of the repository stays one page."""

from pathlib import Path

ROOT = Path(__file__).parents[3]
PRODUCT = ("dbc", "dg_specs", "pe_agent", "manager", "tools")
MOST_LINES = 500  # of a file of the product
MOST_BYTES_OF_THE_MAP = 8192


def test_no_file_of_the_product_is_too_long() -> None:
    files = (file for place in PRODUCT for file in sorted((ROOT / place).rglob("*.py")))
    lengths = {file: file.read_text(encoding="utf-8").count("\n") for file in files}
    too_long = [f"{file.relative_to(ROOT)}: {lines} lines" for file, lines in lengths.items() if lines > MOST_LINES]
    assert not too_long, f"divide what has more than {MOST_LINES} lines: {', '.join(too_long)}"


def test_the_map_is_one_page() -> None:
    assert (ROOT / "ARCHITECTURE.md").stat().st_size <= MOST_BYTES_OF_THE_MAP
