"""Every module of the shipped specs has its image, and every image gives what the spec says it gives."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from agent.installed_package import install
from agent.rig import Flight, best_modes
from heronry_agent.module import Module
from heronry_agent.shell import image_catalogues
from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.aircraft.images import CATALOGUE
from heronry_wire.canaerospace import DataType, Datum, encode_data

SPECS = {name: load(shipped_spec_path(name)) for name in shipped_spec_names()}


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_entry_is_a_module(name: str) -> None:
    assert issubclass(find_image(name), Module)


@pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS.keys())
def test_every_module_of_a_shipped_spec_has_an_image(spec: Spec) -> None:
    assert {module.image for module in spec.modules.values()} <= CATALOGUE.keys()


def test_no_image_is_without_a_user() -> None:
    examples = map(load, Path("dg_specs/examples").iterdir())
    used = {module.image for spec in (*SPECS.values(), *examples) for module in spec.modules.values()}
    assert used == CATALOGUE.keys()


def test_an_image_of_ones_own_is_imported() -> None:
    assert find_image("heronry_tools.aircraft.images.imaging:ImageArchive") is find_image("image_archive")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("elevator_contol", "there is no image 'elevator_contol'; did you mean 'elevator_control'?"),
        ("zzzzzz", "there is no image 'zzzzzz'; write package.module:Class for code of your own"),
        ("no.such.thing:Here", "cannot import no.such.thing"),
        (":Here", "there is no image ':Here'; write package.module:Class"),
        ("..relative:Here", "there is no image '..relative:Here'; write package.module:Class"),
        ("heronry_tools.aircraft.images.imaging:Nothing", "has no class Nothing"),
        ("heronry_tools.aircraft.images.imaging:word", "has no class word"),
        ("heronry_tools.aircraft.images.mission:Stage", "has no class Stage"),
    ],
)
def test_an_unknown_image_is_told_in_a_sentence(name: str, sentence: str) -> None:
    with pytest.raises(UnknownImageError, match=re.escape(sentence)):
        find_image(name)


@pytest.fixture
def _afresh() -> Iterator[None]:
    """Catalogues are looked for once, so not before and not after."""
    image_catalogues._catalogues.cache_clear()
    yield
    image_catalogues._catalogues.cache_clear()


@pytest.mark.usefixtures("_afresh")
def test_a_package_adds_images_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    code = "NAMES = {'kestrel': 'heronry_tools.aircraft.images.imaging:ImageArchive'}\n"
    install(tmp_path, monkeypatch, "kestrels", code, "heronry.images", kestrels="kestrels:NAMES")
    assert find_image("kestrel") is find_image("image_archive")


@pytest.mark.usefixtures("_afresh")
@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import no_such_thing\n", "ModuleNotFoundError: No module named 'no_such_thing'"),
        ("1 / 0\n", "ZeroDivisionError: division by zero"),
        ("", "AttributeError: module 'broken_2' has no attribute 'NAMES'"),
        ("NAMES = 7\n", "TypeError: 'int' object is not iterable"),
    ],
)
def test_a_catalogue_that_cannot_be_loaded_takes_no_other_down_and_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, request: pytest.FixtureRequest, code: str, reason: str
) -> None:
    name = f"broken_{request.node.callspec.indices['code']}"
    install(tmp_path, monkeypatch, name, code, "heronry.images", **{name: f"{name}:NAMES"})
    assert issubclass(find_image("image_archive"), Module)
    with pytest.raises(UnknownImageError, match=re.escape(f"; catalogue '{name}' cannot be loaded ({reason})")):
        find_image("kestrel")


EVERY_MODE = [
    pytest.param(spec, name, mode, id=f"{spec.name}-{name}-{mode}")
    for spec in SPECS.values()
    for name, module in spec.modules.items()
    for mode in module.modes
]


@pytest.mark.parametrize(("spec", "name", "mode"), EVERY_MODE)
def test_every_mode_gives_its_variables_in_values_that_the_wire_carries(spec: Spec, name: str, mode: str) -> None:
    flight = Flight(spec, best_modes(spec) | {name: mode})
    flight.fly(2)  # on the field, with every sensor alive
    for variable, version in spec.modules[name].modes[mode].gives.items():
        value, _, _ = flight.data[variable][version]
        encode_data(1536, Datum(92, DataType[spec.variables[variable].type], 0, 0, value))


@pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS.keys())
def test_no_image_minds_a_missing_input(spec: Spec) -> None:
    """Each module alone, without any of its inputs: on a real PE that is what a first step may look like."""
    for name, module in spec.modules.items():
        for mode in module.modes:
            flight = Flight(spec, {name: mode})
            flight.fly(5)
            assert [r for r in flight.reports if not r.startswith("device:")] == []
