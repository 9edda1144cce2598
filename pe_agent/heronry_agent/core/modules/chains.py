"""Which modules wait for which: those that read from modules on their own PE (`schedule`)."""

from heronry_agent.core.table_index import TableIndex
from heronry_wire.configuration_slice import Slice


def chains(index: TableIndex, wanted: Slice) -> dict[int, frozenset[int]]:
    """Map the index of each module that reads from modules on this PE to the indices of those modules."""
    here = {index.modules[module.module].name: module.module for module in wanted.modules}
    found = {}
    for module in wanted.modules:
        local = (source for source in module.sources if source is not None and source not in wanted.remote)
        producers = frozenset(here[index.table.sources[source].module] for source in local)
        if producers:
            found[module.module] = producers
    return found
