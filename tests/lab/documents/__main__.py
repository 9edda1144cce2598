"""Write the tables and diagrams of a documentation page anew: `python -m lab.documents docs/*.md docs/protocol/*.md`.

A page says where a table or a diagram belongs, and everything between the two marks is replaced; the first mark names
the command, so that a reader of the page's source does not edit what is generated:

    <!-- table: identifiers (generated: python -m lab.documents PAGE) -->
    ...
    <!-- end of table -->

Text that a person writes stands outside of the marks. A test compares every page with the output of this program.
"""

import argparse
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from heronry_tools.console.errors import exit_code
from lab.documents import canopen_tables, event_table, protocol_tables, spec_tables, state_diagrams

TABLES: Mapping[str, Callable[[], str]] = {
    "spec keys": spec_tables.keys,
    "spec limits": spec_tables.limits,
    "identifiers": protocol_tables.identifiers,
    "data types": protocol_tables.data_types,
    "messages": protocol_tables.messages,
    "fields": protocol_tables.fields,
    "times": protocol_tables.times,
    "room to grow": protocol_tables.room,
    "objects": canopen_tables.objects,
    "events of a manager": event_table.of_managers,
    "events about PEs": event_table.of_pes,
    "events about the situation": event_table.of_the_situation,
    "events about plans and epochs": event_table.of_epochs,
    "events of a demo": event_table.of_the_demo,
    "events of a feed": event_table.of_feeds,
    "records in events": event_table.records,
}

DIAGRAMS: Mapping[str, Callable[[], str]] = {
    "mastership of a manager": state_diagrams.mastership_of_a_manager,
    "standing of a PE": state_diagrams.standing_of_a_pe,
    "stage of an epoch": state_diagrams.stage_of_an_epoch,
}

_PLACE = re.compile(
    r"<!-- (?P<kind>table|diagram): (?P<name>[^>(]+?)(?: \([^)]*\))? -->\n.*?<!-- end of (?P=kind) -->", re.DOTALL
)
_COMMAND = "generated: python -m lab.documents PAGE"


def filled(page: str) -> str:
    """Return the page with its tables and diagrams from the present code; raises KeyError for an unknown name."""
    return _PLACE.sub(_written, page)


def _written(place: re.Match[str]) -> str:
    kind, name = place["kind"], place["name"]
    content = (TABLES if kind == "table" else DIAGRAMS)[name]()
    return f"<!-- {kind}: {name} ({_COMMAND}) -->\n\n{content}\n\n<!-- end of {kind} -->"


def main(argv: Sequence[str] | None = None) -> None:
    """Rewrite the pages that the command line names."""
    parser = argparse.ArgumentParser(
        prog="python -m lab.documents", description="Write the tables and diagrams of documentation pages anew."
    )
    parser.add_argument("pages", metavar="PAGE", type=Path, nargs="+", help="a page of docs/, rewritten in place")
    for page in parser.parse_args(argv).pages:
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(exit_code(main, "reference"))
