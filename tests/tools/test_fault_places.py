"""What an oracle takes for failed after reports, acknowledgements and commands of the wire."""

from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.oracles.places import Places
from heronry_wire.management import ElementKind, Emergency, FaultCode

SPEC = load_spec("elevator_and_chute")
FIRST, SECOND = list(SPEC.pes)[:2]
NODES = {name: pe.node_id for name, pe in SPEC.pes.items()}
LOGIC = list(SPEC.modules).index("chute_logic")


def crashed(places: Places, pe: str) -> str | None:
    places.reported(pe, Emergency(FaultCode.MODULE_EXCEPTION, 0, ElementKind.MODULE, LOGIC, 0))
    return places.acknowledged(NODES[pe], ElementKind.MODULE, LOGIC)


def test_a_module_is_out_on_one_pe_and_then_everywhere() -> None:
    places = Places(SPEC)
    assert crashed(places, FIRST) == f"module:chute_logic@{FIRST}"
    assert crashed(places, SECOND) == "module:chute_logic"


def test_an_acknowledged_suspicion_of_a_pe_or_a_bus_fails_nothing() -> None:
    places = Places(SPEC)
    for kind in (ElementKind.PE, ElementKind.BUS):
        places.reported(FIRST, Emergency(FaultCode.REPORTED, 0, kind, 0, 0))
        assert places.acknowledged(NODES[FIRST], kind, 0) is None


def test_clear_names_the_place_by_its_node_and_a_cleared_place_adds_up_no_longer() -> None:
    places = Places(SPEC)
    assert crashed(places, FIRST) == f"module:chute_logic@{FIRST}"
    cleared = places.told(ElementKind.MODULE | NODES[FIRST] << 8, LOGIC)
    assert cleared == f"module:chute_logic@{FIRST}"
    places.cleared(cleared)
    assert crashed(places, SECOND) == f"module:chute_logic@{SECOND}"
    assert places.told(ElementKind.MODULE, LOGIC) == "module:chute_logic"
