"""The source text that is written for compilation: another text, the same classes."""

import dataclasses
import sys
from types import ModuleType
from typing import Any

import pytest

from heronry_tools.sim.compiled.native_classes import with_native_classes

SOURCE = '''
from collections import deque
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple


@dataclass(frozen=True, slots=True)
class Tag:
    """A frozen one."""

    number: int
    kind: str = "plain"


@dataclass(slots=True, eq=False)
class Crate:
    things: list[int] = field(default_factory=list)
    few: deque[int] = field(default_factory=lambda: deque(maxlen=2), init=False)
    lid: bool = field(default=True, init=False)
    weight: int = field(default=0, repr=False)
    most: ClassVar[int] = 7

    def __post_init__(self) -> None:
        self.weight += len(self.things)


class Pair(NamedTuple):
    left: int
    right: int = 2

    def total(self) -> int:
        return self.left + self.right


class Triple(NamedTuple):
    one: int
    two: int
    three: int


@dataclass(frozen=True)
class Nothing:
    """No field."""


class Base:
    """Somebody else's parent."""


class Plain:
    def __init__(self) -> None:
        self.a = 1
'''


def made(text: str) -> Any:
    module = ModuleType("made")
    sys.modules["made"] = module  # dataclasses look there for types
    exec(text, module.__dict__)
    return module


@pytest.fixture
def native() -> Any:
    return made(with_native_classes(SOURCE, ("Pair", "Plain"), ("Base",)))


def test_a_dataclass_has_a_constructor_and_is_otherwise_the_same(native: Any) -> None:
    plain = made(SOURCE)
    for module in (plain, native):
        one, other = module.Tag(3), module.Tag(number=3, kind="plain")
        assert one == other
        assert hash(one) == hash(other)
        assert repr(one) == "Tag(number=3, kind='plain')"
        assert dataclasses.replace(one, kind="odd") == module.Tag(3, "odd")
        assert module.Nothing() == module.Nothing()
        match one:
            case module.Tag(number, kind):
                assert (number, kind) == (3, "plain")
    assert "def __init__(self, number: int, kind: str = 'plain') -> None:" in with_native_classes(SOURCE)


def test_what_is_made_anew_is_made_anew_each_time(native: Any) -> None:
    one, other = native.Crate(), native.Crate([1, 2])
    one.things.append(5)
    assert (native.Crate().things, one.lid, other.weight, native.Crate.most) == ([], True, 2, 7)
    assert one != other
    assert hash(one) != hash(other)


def test_a_named_tuple_becomes_a_class_on_request(native: Any) -> None:
    pair = native.Pair(1)
    assert (pair.total(), pair._replace(left=4), pair == native.Pair(1, 2)) == (3, native.Pair(4), True)
    assert not isinstance(pair, tuple)
    assert native.Triple(1, 2, 3) == (1, 2, 3)


def test_what_is_made_often_is_nothing_to_the_garbage_collector() -> None:
    assert with_native_classes(SOURCE).count("acyclic=True") == 0
    assert with_native_classes(SOURCE, ("Pair", "Crate")).count("acyclic=True, free_list_len=1") == 2


def test_a_base_is_open_to_classes_in_python(native: Any) -> None:
    class Mine(native.Base):
        pass

    assert isinstance(Mine(), native.Base)
    assert "allow_interpreted_subclasses=True" in with_native_classes(SOURCE, (), ("Base",))
    assert "allow_interpreted_subclasses" not in with_native_classes(SOURCE)


@pytest.mark.parametrize(
    "text",
    [
        "class Plain:\n    pass\n",
        "@dataclass\nclass Own:\n    a: int\n\n    def __init__(self) -> None:\n        self.a = 1\n",
        "@dataclass\nclass Derived(Base):\n    a: int\n",
        "@final\n@dataclass\nclass Two:\n    a: int\n",
        "@register\nclass Other:\n    a: int\n",
        "@module.dataclass\nclass Foreign:\n    a: int\n",
        "@dataclass\nclass Named:\n    a: int = field(kw_only=True)\n",
        "@dataclass\nclass Unclear:\n    a: list[int] | None = field(default_factory=list)\n",
        "class Kept(NamedTuple):\n    a: int\n",
        "class Shared(NamedTuple):\n    a: list[int] = []\n",
    ],
)
def test_what_is_not_understood_stays_as_it_is(text: str) -> None:
    assert with_native_classes(text, ("Shared",)) == text
