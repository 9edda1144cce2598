"""What a person may have meant by a name that does not exist."""

from heronry_wire.spelling import close, meant


def test_the_closest_name_is_asked_for_and_else_all_are_told() -> None:
    assert meant("nva", ["nav", "air"]) == "did you mean 'nav'?"
    assert meant("tail", ["nav", "air"]) == "there is nav, air"
    assert meant("tail", ["nav"], "name a PE") == "name a PE"
    assert meant("tail", []) == "there is none"
    assert close("nav", ["air"]) is None


def test_of_many_names_the_first_ones_are_told() -> None:
    said = meant("?", [f"module_{number}" for number in range(100)])
    assert said.startswith("there is module_0, module_1, ")
    assert said.endswith(", module_39 and 60 more")
