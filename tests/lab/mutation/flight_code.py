"""The files of the cores, which decide in flight, and of the codec of their frames. All tools use this list.

    python -m lab.mutation.flight_code     their files, joined by commas, for `coverage report --include`

Tests run every branch of these files (`make coverage` fails otherwise), and mutants are drawn from the cores. A core is
every file in a folder `core`, and the planning policy beside one; the files of the codec, which share a folder with
others, are listed by name. A test keeps the list complete.
"""

from collections.abc import Iterator
from pathlib import Path

CORES = (Path("manager/heronry_manager/core"), Path("pe_agent/heronry_agent/core"))
POLICY = Path("manager/heronry_manager/planning_policy.py")
DESCRIBING = frozenset(("__init__", "events", "status", "vocabulary"))  # no decision in flight depends on them
WIRE = Path("dbc/heronry_wire")
CODEC = (
    "authentication part_transfer bus_health canaerospace canopen_objects capacities channel_merge channel_watch "
    "checkpoint_frames command_tags compressed_table "
    "configuration_slice contingency_block controller element_places errors failure_text frame gateway_report "
    "identification identifiers layout management nmt node_offer node_services packing pe_table protocol_times "
    "protocol_version sansio sdo silence standard_identifiers state_frames thinning timing transmit_queue"
)
SHELL = (  # of the wire: the files that use sockets, interfaces and files, or a person's words
    "__init__ arrival_times bare_can bundle bundle_keys bundle_needs bundle_signing bus_arguments bus_opening "
    "can_interface clock_of_day command_parser eds frame_port interruption key_file link node_cost ordinary_file "
    "parent_death patient_port python_can replicated_link "
    "runtime_folder service_manager slow_opening socketcand spelling standstill"
)


def core_files(checkout: Path = Path()) -> Iterator[Path]:
    """Yield the files of the cores, relative to the checkout."""
    for core in CORES:
        files = sorted((checkout / core).rglob("*.py"))
        yield from (file.relative_to(checkout) for file in files if file.stem not in DESCRIBING)
    yield POLICY


def codec_files() -> Iterator[Path]:
    """Return the files of the codec, relative to the checkout."""
    return (WIRE / f"{name}.py" for name in CODEC.split())


if __name__ == "__main__":
    print(",".join(map(str, (*core_files(), *codec_files()))))
