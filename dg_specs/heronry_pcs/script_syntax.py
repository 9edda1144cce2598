"""Reads the text of a reconfiguration script: splits it into tokens, and these into statements with their lines.

    script = { "define" NAME ";" | [NAME "="] NAME "." op ";" }     // comment
    op = CreateComponent(STRING) | DeleteComponent(NAME or STRING) | PruneEdges()
       | CreateEdge(STRING, STRING) | DeleteEdge(STRING, STRING)

NAME is `[A-Za-z_][A-Za-z0-9_]*`; a STRING has no escapes. If a statement cannot be read (PCS101), or names an operation
that does not exist (PCS102), the error has the place of the token where reading failed. Reading continues behind the
next `;`, or at the next line that begins a statement, whichever comes first.

Source: the paper that graph.py names, Figure 16, "ReflectionScript Language"; the paper has no DeleteEdge.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

NAME: Final = re.compile("[A-Za-z_][A-Za-z0-9_]*")
_TOKEN: Final = re.compile(
    r"(?P<line>\n)|(?P<blank>[ \t\r\f\v]+|//[^\n]*)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r'|"(?P<string>[^"\n]*)"|(?P<other>.)'
)

_STRING: Final = ("a text in quotes",)
_KINDS: Final = {"name": "a name", "string": "a text in quotes"}
_SHAPES: Final[dict[str, tuple[tuple[str, ...], ...]]] = {  # operation -> what each argument may be
    "CreateComponent": (_STRING,),
    "DeleteComponent": (("a name", *_STRING),),
    "PruneEdges": (),
    "CreateEdge": (_STRING, _STRING),
    "DeleteEdge": (_STRING, _STRING),
}


@dataclass(frozen=True, slots=True)
class ScriptError:
    """A mistake in a script, with its place.

    The place is the line of the statement, or the line and column of the token where reading failed.
    """

    line: int
    column: int
    code: str
    sentence: str


@dataclass(frozen=True, slots=True)
class Define:
    """`define NAME;`."""

    line: int
    name: str


@dataclass(frozen=True, slots=True)
class Call:
    """The statement `[assigned =] receiver.operation ( arguments );` of a script.

    `assigned` is None if the statement assigns nothing.
    """

    line: int
    assigned: str | None
    receiver: str
    operation: str
    arguments: tuple[str, ...]


Statement = Define | Call


class _Token(NamedTuple):
    kind: str  # "a name", "a text in quotes", the character itself, or "the end"
    text: str
    line: int
    column: int
    is_first: bool  # on its line


class _SyntaxError(Exception):
    def __init__(self, code: str, token: _Token, sentence: str) -> None:
        super().__init__(sentence)
        self.error = ScriptError(token.line, token.column, code, sentence)


def read_script(text: str) -> tuple[list[Statement], list[ScriptError]]:
    """Read a script; gives the statements that could be read, and an error for each statement that could not."""
    return _Parser(list(_tokens(text))).read()


def _tokens(text: str) -> Iterator[_Token]:
    line, begin, is_first = 1, 0, True
    for match in _TOKEN.finditer(text):
        group = match.lastgroup or "other"
        if group == "line":
            line, begin, is_first = line + 1, match.end(), True
        elif group != "blank":
            said = match[group]
            yield _Token(_KINDS.get(group, said), said, line, match.start() - begin + 1, is_first)
            is_first = False
    yield _Token("the end", "the end", line, len(text) - begin + 1, is_first=True)


class _Parser:
    """Reads statements from tokens, one token of look-ahead at a time."""

    def __init__(self, tokens: list[_Token]) -> None:
        self._tokens = tokens
        self._at = 0

    def read(self) -> tuple[list[Statement], list[ScriptError]]:
        statements: list[Statement] = []
        errors: list[ScriptError] = []
        while self._token().kind != "the end":
            try:
                statements.append(self._statement())
            except _SyntaxError as failure:
                errors.append(failure.error)
                self._recover()
        return statements, errors

    def _statement(self) -> Statement:
        first = self._take("a name")
        if first.text == "define":
            name = self._take("a name").text
            self._take(";")
            return Define(first.line, name)
        assigned = None
        receiver = first.text
        if self._token().kind == "=":
            self._take("=")
            assigned, receiver = receiver, self._take("a name").text
        self._take(".")
        operation = self._operation()
        self._take("(")
        arguments = tuple(self._arguments(operation))
        self._take(")")
        self._take(";")
        return Call(first.line, assigned, receiver, operation, arguments)

    def _operation(self) -> str:
        token = self._token()
        if token.kind == "a name" and token.text not in _SHAPES:
            known = ", ".join(_SHAPES)
            raise _SyntaxError("PCS102", token, f"there is no operation '{token.text}'; there is {known}")
        return self._take("a name").text

    def _arguments(self, operation: str) -> Iterator[str]:
        for number, kinds in enumerate(_SHAPES[operation]):
            if number:
                self._take(",")
            yield self._take(*kinds).text

    def _token(self) -> _Token:
        return self._tokens[self._at]

    def _take(self, *kinds: str) -> _Token:
        token = self._token()
        if token.kind not in kinds:
            wanted = " or ".join(kind if len(kind) > 1 else f"'{kind}'" for kind in kinds)
            there = token.text if token.kind == "the end" else f"'{token.text}'"
            raise _SyntaxError("PCS101", token, f"{wanted} is expected here, not {there}")
        self._at += 1
        return token

    def _recover(self) -> None:
        """Skip to the token behind the next `;`, or to the next line that begins a statement."""
        while self._token().kind != "the end" and not self._begins_statement():
            self._at += 1
            if self._tokens[self._at - 1].kind == ";":
                return

    def _begins_statement(self) -> bool:
        token = self._token()
        if not token.is_first or token.kind != "a name":
            return False
        return token.text == "define" or self._tokens[self._at + 1].kind in ("=", ".")
