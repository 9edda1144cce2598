"""Which modules are cores and codec: what decides in flight, and the bytes it speaks. One place says so, for all tools.

    python -m heronry_tools.mutation.flight_code       their files, joined by commas, for `coverage report --include`

Every branch of them is run by some test (`make coverage` fails where one is not), and mutants are drawn from the cores.
What is listed as anything else does no deciding in flight. A test holds the lists complete.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

MANAGER, AGENT, WIRE = "manager/heronry_manager", "pe_agent/heronry_agent", "dbc/heronry_wire"

CORES: Mapping[str, str] = {
    MANAGER: "announcing authenticity beacon checked_lines compilation core deployment exclusion following health "
    "known_situation latched_faults lost_channels memory mission_phase numbering operator_orders overheard "
    "planning radio_links reconfiguration restarts_told topology turn",
    AGENT: "authenticity canopen_node channel_reports core error_history faults gateway link_meter mailboxes "
    "network_management node_services obedience object_dictionary pe_objects permission phase_requests publishing "
    "radio_port radio_queue reconfiguration reign reporting restarts running_modules schedule sdo_server "
    "slice_reading staging table_index turn without_manager",
}
CODEC: Mapping[str, str] = {
    WIRE: "authentication bus_health canaerospace canopen_objects channel_merge channel_watch command_tags "
    "configuration_slice contingency_block controller errors frame gateway_report identification identifiers "
    "layout management node_services packing pe_table sansio sdo standard_identifiers timing transmit_queue",
}
NEITHER: Mapping[str, str] = {
    # shells: sockets, processes, files, command lines
    MANAGER: "__init__ control_client control_place control_protocol control_socket driver journal "
    # what describes, and what computes ahead: nothing in flight depends on it
    "events fault_cases management_times reconfiguration_bound status vocabulary",
    AGENT: "__init__ __main__ cli devices driver host incarnation module module_runner partition "
    "partition_groups partition_host partition_messages partition_process ports table_waiting vocabulary",
    WIRE: "__init__ bus_arguments bus_opening can_interface eds key_file link python_can replicated_link "
    "service_manager slow_opening socketcand",
}


def core_files() -> Iterator[Path]:
    """Files of the cores, from the folder of the checkout."""
    return _files(CORES)


def codec_files() -> Iterator[Path]:
    """Files of the codec, from the folder of the checkout."""
    return _files(CODEC)


def _files(rooms: Mapping[str, str]) -> Iterator[Path]:
    return (Path(room, f"{name}.py") for room, names in rooms.items() for name in names.split())


if __name__ == "__main__":
    print(",".join(map(str, (*core_files(), *codec_files()))))
