"""All small defects that one file could have, each as a replacement of a piece of its text.

Four kinds, of which every mutant has one:

- *comparison*: another comparison, `and` for `or`, a `not` left out;
- *constant*: an integer one greater, True for False;
- *deletion*: a simple statement left out;
- *statement*: a condition turned round, a sum for a difference, `break` for `continue`, a result that is not returned.

Left alone is what no flight depends on: docstrings, annotations, texts, imports, decorators, and statements that raise
an error of our own. A mutant may still behave like the original; a reviewer says so of a survivor, no program can.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
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

    def applied_to(self, source: bytes) -> bytes:
        """The file with the defect."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def describe(self, source: bytes) -> str:
        """One line: where, and what became of what."""
        before = " ".join(source[self.start : self.end].decode().split())
        return f"{self.file}:{self.line}: {self.kind}: {before or 'nothing'} -> {self.text}"


def mutants_of(file: PurePath, source: bytes) -> list[Mutant]:
    """Every mutant of a file, in the order of the text; each of them compiles."""
    found = sorted(set(_Finder(file, source).all()))
    return [mutant for mutant in found if _compiles(mutant.applied_to(source))]


def _compiles(source: bytes) -> bool:
    try:
        compile(source, "mutant", "exec")
    except SyntaxError:
        return False
    return True


class _Finder:
    """Walks over one file."""

    def __init__(self, file: PurePath, source: bytes) -> None:
        self._file, self._source = file, source
        self._line_starts = [0]
        for line in source.splitlines(keepends=True):
            self._line_starts.append(self._line_starts[-1] + len(line))

    def all(self) -> Iterator[Mutant]:
        """Every mutant, also those that do not compile."""
        yield from self._in(ast.parse(self._source))

    def _in(self, node: ast.AST) -> Iterator[Mutant]:
        yield from self._of(node)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "type_params"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not _is_left_alone(child):
                    yield from self._in(child)

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
            case ast.Return(value) if value is not None and not _is_none(value):
                yield self._replaced(node, "return None", "statement")
            case ast.Break():
                yield self._replaced(node, "continue", "statement")
            case ast.Continue():
                yield self._replaced(node, "break", "statement")
        if isinstance(node, _DELETED) and not (isinstance(node, ast.AnnAssign) and node.value is None):
            yield self._replaced(node, "pass", "deletion")

    def _text(self, node: ast.expr) -> str:
        return self._source[slice(*self._span(node))].decode()

    def _span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        return (
            self._line_starts[node.lineno - 1] + node.col_offset,
            self._line_starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0),
        )

    def _replaced(self, node: ast.expr | ast.stmt, text: str, kind: str) -> Mutant:
        return Mutant(self._file, *self._span(node), text, kind, node.lineno)

    def _between(self, before: ast.expr, after: ast.expr, words: tuple[str, str], kind: str) -> Mutant:
        """Replace a word that stands between two expressions."""
        gap = slice(self._span(before)[1], self._span(after)[0])
        start = gap.start + self._source[gap].index(words[0].encode())
        line = self._source.count(b"\n", 0, start) + 1
        return Mutant(self._file, start, start + len(words[0]), words[1], kind, line)


def _is_left_alone(node: ast.AST) -> bool:
    match node:
        case ast.Expr(ast.Constant()) | ast.Import() | ast.ImportFrom() | ast.Raise() | ast.JoinedStr():
            return True
        case ast.Expr(ast.Call(ast.Name("assert_never"))):
            return True
    return False


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None
