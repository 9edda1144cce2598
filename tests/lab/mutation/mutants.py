"""All small defects that one file could have, each as a replacement of a piece of its text.

Four kinds, of which every mutant has one:

- *comparison*: another comparison, `and` for `or`, a `not` left out;
- *constant*: an integer one greater, True for False;
- *deletion*: a simple statement left out;
- *statement*: a condition turned round, a sum for a difference, `break` for `continue`, a result that is not returned.

Left alone is what no flight depends on: docstrings, annotations, texts, imports, decorators, the content of an event
(but not that it is emitted), statements that raise one of our errors; and the invariants, which check the code and are
not checked. Left alone is also what changes nothing by construction: a `return None` that ends a function, or None for
the False of a function that returns bool. A mutant may still behave like the original; of a survivor a reviewer decides
that, no program can.

Every mutant has the lines of its statement, so that a mutant that no flight runs need not be tried.
"""

import ast
from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import PurePath

_COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}
_OPERATORS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "+"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "//"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
}
_DELETED = (ast.Expr, ast.Assign, ast.AugAssign, ast.AnnAssign, ast.Return, ast.Delete, ast.Break, ast.Continue)


@dataclass(frozen=True, slots=True, order=True)
class Mutant:
    """One defect: in `file`, the bytes `start`..`end` become `text`."""

    file: PurePath
    start: int
    end: int
    text: str
    kind: str
    line: int
    first_line: int
    last_line: int  # of the statement, or of the head of a compound statement
    function: str  # around the mutant, with its class; "" where the import runs it

    def is_run_by(self, lines: Container[int]) -> bool:
        """Tell whether a flight that runs these lines of the file runs the mutant; every flight runs imports."""
        return not self.function or any(line in lines for line in range(self.first_line, self.last_line + 1))

    def applied_to(self, source: bytes) -> bytes:
        """Return the file with the defect."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def describe(self, source: bytes) -> str:
        """Return one line: the place, the text before and after."""
        before = " ".join(source[self.start : self.end].decode().split())
        return f"{self.file}:{self.line}: {self.kind}: {before or 'nothing'} -> {self.text}"


def mutants_of(file: PurePath, source: bytes) -> list[Mutant]:
    """Return every mutant of a file, in the order of the text; a few do not compile."""
    return sorted(set(_Finder(file, source).all()))


def compiles(mutant: Mutant, source: bytes) -> bool:
    """Tell whether a mutant of this file compiles."""
    try:
        compile(mutant.applied_to(source), "mutant", "exec")
    except SyntaxError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class _Place:
    """The place of the walk: lines of the statement, and the function, as Class.function."""

    first_line: int = 1
    last_line: int = 1
    class_name: str = ""
    function: str = ""
    answers: bool = False  # the function returns bool
    ends: tuple[ast.stmt, ...] = ()  # the function ends with these


class _Finder:
    """Finds the mutants of one file."""

    def __init__(self, file: PurePath, source: bytes) -> None:
        self._file, self._source = file, source
        self._place = _Place()
        self._line_starts = [0]
        for line in source.splitlines(keepends=True):
            self._line_starts.append(self._line_starts[-1] + len(line))

    def all(self) -> Iterator[Mutant]:
        yield from self._in(ast.parse(self._source), _Place())

    def _in(self, node: ast.AST, around: _Place) -> Iterator[Mutant]:
        self._place = place = _at(node, around)
        yield from self._of(node)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "type_params"):
                continue
            within = _within(node, place) if name == "body" else place
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not _is_left_alone(child):
                    yield from self._in(child, within)

    def _of(self, node: ast.AST) -> Iterator[Mutant]:
        match node:
            case ast.Compare(left, operators, comparators):
                sides = [left, *comparators]
                for operator, (before, after) in zip(operators, pairwise(sides), strict=True):
                    yield self._between(before, after, _COMPARISONS[type(operator)], "comparison")
            case ast.BoolOp(operator, values):
                words = ("and", "or") if isinstance(operator, ast.And) else ("or", "and")
                for before, after in pairwise(values):
                    yield self._between(before, after, words, "comparison")
            case ast.UnaryOp(ast.Not(), operand):
                yield self._replaced(node, self._text(operand), "comparison")
            case ast.Constant(bool() as value):
                yield self._replaced(node, str(not value), "constant")
            case ast.Constant(int() as value):
                yield self._replaced(node, str(value + 1), "constant")
            case ast.BinOp(left, operator, right) if type(operator) in _OPERATORS:
                yield self._between(left, right, _OPERATORS[type(operator)], "statement")
        yield from self._of_statement(node)

    def _of_statement(self, node: ast.AST) -> Iterator[Mutant]:
        match node:
            case ast.If(test) | ast.While(test) | ast.IfExp(test):
                yield self._replaced(test, f"(not ({self._text(test)}))", "statement")
            case ast.AugAssign(target, operator, value) if type(operator) in _OPERATORS:
                before, after = _OPERATORS[type(operator)]
                yield self._between(target, value, (before + "=", after + "="), "statement")
            case ast.Return(value) if value is not None and not self._means_none(value):
                yield self._replaced(node, "return None", "statement")
            case ast.Break():
                yield self._replaced(node, "continue", "statement")
            case ast.Continue():
                yield self._replaced(node, "break", "statement")
        if isinstance(node, _DELETED) and not self._is_nothing(node):
            yield self._replaced(node, "pass", "deletion")

    def _means_none(self, value: ast.expr | None) -> bool:
        """Tell whether the caller of the function treats this value and None alike."""
        is_no = isinstance(value, ast.Constant) and value.value is False
        return value is None or _is_none(value) or (is_no and self._place.answers)

    def _is_nothing(self, node: ast.AST) -> bool:
        """Tell whether a statement has no effect on a flight."""
        if isinstance(node, ast.AnnAssign):
            return node.value is None
        return isinstance(node, ast.Return) and node in self._place.ends and self._means_none(node.value)

    def _text(self, node: ast.expr) -> str:
        return self._source[slice(*self._span(node))].decode()

    def _span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        return (
            self._line_starts[node.lineno - 1] + node.col_offset,
            self._line_starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0),
        )

    def _replaced(self, node: ast.expr | ast.stmt, text: str, kind: str) -> Mutant:
        return self._mutant(*self._span(node), text, kind, node.lineno)

    def _between(self, before: ast.expr, after: ast.expr, words: tuple[str, str], kind: str) -> Mutant:
        """Replace a word that stands between two expressions."""
        gap = slice(self._span(before)[1], self._span(after)[0])
        start = gap.start + self._source[gap].index(words[0].encode())
        line = self._source.count(b"\n", 0, start) + 1
        return self._mutant(start, start + len(words[0]), words[1], kind, line)

    def _mutant(self, start: int, end: int, text: str, kind: str, line: int) -> Mutant:
        place = self._place
        return Mutant(self._file, start, end, text, kind, line, place.first_line, place.last_line, place.function)


def _at(node: ast.AST, around: _Place) -> _Place:
    """Return the place of a node: its own statement, or the one around it."""
    body = getattr(node, "body", None)
    match node:
        case ast.match_case(pattern):
            return replace(around, first_line=pattern.lineno, last_line=node.body[0].lineno)
        case ast.stmt() if isinstance(body, list):
            return replace(around, first_line=node.lineno, last_line=max(node.lineno, body[0].lineno - 1))
        case ast.stmt():
            return replace(around, first_line=node.lineno, last_line=node.end_lineno or node.lineno)
    return around


def _within(node: ast.AST, place: _Place) -> _Place:
    """Return the place of the statements in the body of a node."""
    match node:
        case ast.ClassDef(name):
            return replace(place, class_name=f"{name}.")
        case ast.FunctionDef(name, returns=returns, body=body):
            answers = isinstance(returns, ast.Name) and returns.id == "bool"
            function = place.function or f"{place.class_name}{name}"
            return replace(place, function=function, answers=answers, ends=tuple(_ends(body)))
    return place


def _ends(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield the statements with which a function may end."""
    last = body[-1]
    yield last
    if isinstance(last, ast.If):
        yield from _ends(last.body)
        if last.orelse:
            yield from _ends(last.orelse)


def _is_left_alone(node: ast.AST) -> bool:
    match node:
        case ast.Expr(ast.Constant()) | ast.Import() | ast.ImportFrom() | ast.Raise() | ast.JoinedStr():
            return True
        case ast.Expr(ast.Call(ast.Name("assert_never" | "require"))):
            return True
        case ast.FunctionDef(name) if name.lstrip("_").startswith(("validate", "emit_", "status")):
            return True
        case ast.Call(ast.Attribute(attr="emit")):
            return True
    return False


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None
