"""Rewrites a module for mypyc: constructors that can be compiled, and constants that are declared constant.

mypyc makes a native class of a dataclass, but the methods that `dataclass` generates stay Python: creating a frozen
dataclass takes a microsecond, compiled or not, and creating a named tuple half of that. A flight creates ten such
objects for each frame. mypyc does compile a constructor that stands in the source of a class. So this file makes a copy
of the source in which each dataclass has a constructor, and mypyc compiles the copy:

    @dataclass(frozen=True, slots=True)         @dataclass(unsafe_hash=True, init=False)
    class Tag:                                  class Tag:
        number: int                                 number: int
        kind: int = 0                               kind: int = 0
                                                    def __init__(self, number: int, kind: int = 0) -> None: ...

A named tuple becomes such a dataclass if the caller requests it. The tuple can then no longer be unpacked or indexed.
mypy checks the copy first, and refuses code that unpacks or indexes the tuple. Equality, hash, `repr` and matching are
those of a dataclass. The copy need not enforce that frozen values stay unchanged: mypy has checked that in the source.

A class of which objects are created often is also declared acyclic: an unchanging value that holds only unchanging
values cannot refer to itself, so the garbage collector need not track it. The memory of the object that was freed last
is used for the next object.

A name in capitals that a module assigns once is declared `Final`: mypyc looks up any other name at each use.

Two kinds of classes are declared to mypyc: a class from which Python classes may derive, and an exception, which stays
a Python class.

A class with bases, or with a constructor in its source, is not supported and stays as it is.
"""

import ast
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

_LAMBDA = "lambda: "  # of a factory: its body makes the value
_CONSTANT = re.compile("_?[A-Z][A-Z0-9_]+")
_DATACLASS = "import dataclasses as _dataclasses\nimport typing as _typing\n{}@_dataclasses.dataclass({})"
_ATTRIBUTE = "import mypy_extensions as _mypy\n@_mypy.mypyc_attr({})"
_MADE_OFTEN = _ATTRIBUTE.format("acyclic=True, free_list_len=1") + "\n"
_REPLACE = """
    def _replace(self, **changes: _typing.Any) -> "{0}":
        return _dataclasses.replace(self, **changes)"""


@dataclass(frozen=True, slots=True)
class _Field:
    """One field of a dataclass, in source text.

    kind: its type
    default: its default value; None if it has none
    factory: the function that makes its default value; None if it has none
    is_given: whether the constructor has a parameter for it
    """

    name: str
    kind: str
    default: str | None = None
    factory: str | None = None
    is_given: bool = True

    def parameter(self) -> str:
        """Return the constructor's parameter for the field, in source text."""
        if self.factory is not None:
            return f"{self.name}: {self.kind} | None = None"
        return f"{self.name}: {self.kind}" + ("" if self.default is None else f" = {self.default}")

    def assignment(self) -> str:
        """Return the statement by which the constructor sets the field, in source text."""
        if self.factory is None:
            return f"self.{self.name} = {self.name if self.is_given else self.default}"
        made = self.factory.removeprefix(_LAMBDA) if self.factory.startswith(_LAMBDA) else f"{self.factory}()"
        return f"self.{self.name} = " + (f"{made} if {self.name} is None else {self.name}" if self.is_given else made)


def with_native_classes(source: str, often: Collection[str] = (), bases: Collection[str] = ()) -> str:
    """Return the source of a module after giving its dataclasses constructors that can be compiled.

    often: classes that are created often; named tuples among these become dataclasses, too
    bases: classes from which Python classes may derive
    """
    lines = source.splitlines()
    for node in reversed(ast.parse(source).body):
        if isinstance(node, ast.Assign | ast.AnnAssign):
            _make_final(node, lines)
        if isinstance(node, ast.ClassDef):
            _rewrite(node, lines, often)
            if node.name in bases:
                lines.insert(_first(node) - 1, _ATTRIBUTE.format("allow_interpreted_subclasses=True"))
            if any(ast.unparse(base).endswith("Error") for base in node.bases):
                lines.insert(_first(node) - 1, _ATTRIBUTE.format("native_class=False"))
    return "\n".join([*lines, ""])


def _make_final(node: ast.Assign | ast.AnnAssign, lines: list[str]) -> None:
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    if not isinstance(target, ast.Name) or not _CONSTANT.fullmatch(target.id) or node.value is None:
        return
    if isinstance(node.value, ast.Tuple):  # mypyc wrongly reads a Final tuple of numbers as never set
        return
    line, kind = lines[node.lineno - 1], "_typing.Final"
    if isinstance(node, ast.AnnAssign):
        if node.annotation.end_lineno != node.lineno:
            return
        told = ast.unparse(node.annotation)
        kind = told if told.startswith("Final") else f"{kind}[{told}]"
    rest = line[node.value.col_offset :] if node.value.lineno == node.lineno else "("
    lines[node.lineno - 1] = f"{target.id}: {kind} = {rest}"
    lines.insert(node.lineno - 1, "import typing as _typing")


def _rewrite(node: ast.ClassDef, lines: list[str], often: Collection[str]) -> None:
    """Rewrite a class in `lines` as a dataclass with a constructor that can be compiled.

    A class for which this is not possible stays as it is. The lines are changed from the last to the first, so
    that the numbers of earlier lines stay right.

    often: classes that are created often; a named tuple is rewritten only if it is among these
    """
    is_tuple = [*map(ast.unparse, node.bases)] == ["NamedTuple"] and node.name in often
    words = {"unsafe_hash": "True"} if is_tuple else _words(node)
    fields = None if words is None else _fields(node)
    if words is None or fields is None:
        return
    assert node.end_lineno is not None
    more = [*_constructor(node, fields), *(_REPLACE.format(node.name).splitlines() if is_tuple else ())]
    lines[node.end_lineno : node.end_lineno] = more
    if is_tuple:
        lines[node.lineno - 1] = f"class {node.name}:"
    said = ", ".join(f"{word}={value}" for word, value in (words | {"init": "False"}).items())
    above = _DATACLASS.format(_MADE_OFTEN if node.name in often else "", said)
    lines[_first(node) - 1 : node.lineno - 1] = above.splitlines()


def _first(node: ast.ClassDef) -> int:
    """Return the number of the first line of a class, counted from 1, decorators included."""
    return min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])


def _words(node: ast.ClassDef) -> dict[str, str] | None:
    """Return the arguments of the `dataclass` decorator of a class, in the form for the compiled class.

    `slots` and `frozen` are left out. `unsafe_hash=True` stands for `frozen=True`, except if `eq` is False.

    Return None for a class without this decorator, with a further decorator, with a base class, or with a
    constructor of its own.
    """
    if node.bases or len(node.decorator_list) != 1 or "__init__" in _methods(node):
        return None
    decorator = node.decorator_list[0]
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    if not isinstance(called, ast.Name) or called.id != "dataclass":
        return None
    keywords = decorator.keywords if isinstance(decorator, ast.Call) else []
    said = {str(keyword.arg): ast.unparse(keyword.value) for keyword in keywords}
    hashed = said.pop("frozen", "False") == "True" and said.get("eq") != "False"
    said.pop("slots", None)
    return said | ({"unsafe_hash": "True"} if hashed else {})


def _methods(node: ast.ClassDef) -> set[str]:
    return {one.name for one in node.body if isinstance(one, ast.FunctionDef)}


def _fields(node: ast.ClassDef) -> list[_Field] | None:
    """Return the fields of a dataclass; None if one of them cannot be written as a parameter."""
    fields = []
    for one in node.body:
        if not isinstance(one, ast.AnnAssign) or not isinstance(one.target, ast.Name):
            continue
        field = _field(one.target.id, ast.unparse(one.annotation), one.value)
        if field is None:
            return None
        if not field.kind.startswith("ClassVar"):
            fields.append(field)
    return fields


def _field(name: str, kind: str, value: ast.expr | None) -> _Field | None:
    if isinstance(value, ast.Dict | ast.List | ast.Set):  # a dataclass may not have such a default
        return None
    if not isinstance(value, ast.Call) or not isinstance(value.func, ast.Name) or value.func.id != "field":
        return _Field(name, kind, None if value is None else ast.unparse(value))
    said = {str(keyword.arg): ast.unparse(keyword.value) for keyword in value.keywords}
    is_given = said.pop("init", "True") == "True"
    default, factory = said.pop("default", None), said.pop("default_factory", None)
    if "None" in kind and factory is not None:  # None may then be a value, and cannot stand for "not given"
        return None
    for harmless in ("repr", "compare", "hash"):
        said.pop(harmless, None)
    return None if said else _Field(name, kind, default, factory, is_given)


def _constructor(node: ast.ClassDef, fields: list[_Field]) -> Iterator[str]:
    parameters = ", ".join(["self", *(field.parameter() for field in fields if field.is_given)])
    yield from ("", f"    def __init__({parameters}) -> None:")
    body = [field.assignment() for field in fields]
    if "__post_init__" in _methods(node):
        body.append("self.__post_init__()")
    yield from (f"        {line}" for line in body or ["pass"])
