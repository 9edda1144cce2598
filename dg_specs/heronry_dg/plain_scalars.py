"""The value of a plain (unquoted) YAML scalar.

YAML 1.1 and 1.2, and the programs that read them, disagree about `on`, `017`, `12:30:45`, `1_000` and their like. A
spec must have one meaning everywhere, so such a scalar is refused, with a hint what to write instead. Accepted are
numbers in the grammar of JSON (`-1`, `0.05`, `1e-5`), `true`, `false`, `null`, `~`, an empty scalar, and text.

Numbers stay exact: an integer is an `int`, any other number a `Decimal`, whose digits are those of the file. The length
of both is limited, so that no spec can make later arithmetic run for long.

Source: YAML 1.1 types (yaml.org/type: bool, int, float, null, timestamp, merge, value) and YAML 1.2 section 10.3.
"""

import re
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache

from heronry_dg.rules import file
from heronry_dg.rules.rule import Rule

Value = None | bool | int | Decimal | str

_LONGEST_NUMBER = 40
_LARGEST_EXPONENT = 40

_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(?P<fraction>\.[0-9]+)?(?:[eE](?P<exponent>[+-]?[0-9]+))?")
_OTHER_BASE = re.compile(r"[+-]?0(?:x[0-9a-fA-F_]+|b[01_]+|o[0-7_]+|[0-7_]+)")
_BASE_60 = re.compile(r"[+-]?[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?")
_DATE = re.compile(r"[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}(?:[Tt\s].*)?")
_ODD_DECIMAL = re.compile(r"[+-]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9_]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?\.(?:inf|Inf|INF|nan|NaN|NAN)")

_WORDS: dict[str, Value] = {"": None, "~": None, "null": None, "true": True, "false": False}
_SPELLINGS = {"Null": "null", "NULL": "null", "True": "true", "TRUE": "true", "False": "false", "FALSE": "false"}
_BOOLEANS = {
    spelling: meaning
    for word, meaning in {"yes": "true", "on": "true", "no": "false", "off": "false"}.items()
    for spelling in (word, word.capitalize(), word.upper())
}
_MAY_BE_A_NUMBER = frozenset("0123456789+-.")


@dataclass(frozen=True, slots=True)
class Surprise:
    """Why a plain scalar is refused, for example because other YAML programs read it as another value."""

    rule: Rule
    sentence: str
    hint: str


@lru_cache(maxsize=4096)  # a file repeats the same words
def resolve(text: str) -> Value | Surprise:
    """Return the value of a plain scalar, or the reason why it is refused."""
    if text in _WORDS:
        return _WORDS[text]
    if text[0] in _MAY_BE_A_NUMBER:
        return _number(text)
    return _word(text)


def _word(text: str) -> str | Surprise:
    if text in _SPELLINGS:
        hint = f"write {_SPELLINGS[text]}, or '{text}' in quotes for text"
        return Surprise(file.WORD_READ_DIFFERENTLY, f"programs read '{text}' in different ways", hint)
    if text in _BOOLEANS:
        sentence = f"some programs read '{text}' as {_BOOLEANS[text]}"
        hint = f"write {_BOOLEANS[text]}, or '{text}' in quotes for text"
        return Surprise(file.WORD_READ_DIFFERENTLY, sentence, hint)
    if text in {"<<", "="}:
        return Surprise(file.SPECIAL_KEY, f"'{text}' is a special key of YAML 1.1", "write out what it stands for")
    return text


def _number(text: str) -> int | Decimal | str | Surprise:
    match = _NUMBER.fullmatch(text)
    if match is None:
        return _odd_number(text)
    if len(text) > _LONGEST_NUMBER:
        return Surprise(file.LONG_NUMBER, "this number is too long", f"write at most {_LONGEST_NUMBER} characters")
    if match["exponent"] and (len(match["exponent"]) > 4 or abs(int(match["exponent"])) > _LARGEST_EXPONENT):
        hint = f"write an exponent of at most {_LARGEST_EXPONENT}"
        return Surprise(file.LONG_NUMBER, f"the exponent of {text} is too large", hint)
    if match["fraction"] or match["exponent"]:
        return Decimal(text)
    return int(text)


def _odd_number(text: str) -> str | Surprise:
    """Return a text such as `64KiB` unchanged, or a `Surprise` if the text looks like a number or a date.

    A text looks like one of these if some other program would read it so, or if it is a number in a form that
    specs do not allow.
    """
    shown = text if len(text) <= _LONGEST_NUMBER else text[:_LONGEST_NUMBER] + "..."
    if _OTHER_BASE.fullmatch(text):
        return Surprise(file.NOT_DECIMAL, f"'{shown}' is not a decimal number", _decimal_hint(text))
    if _BASE_60.fullmatch(text):
        sentence = f"some programs read '{shown}' as a number to the base 60"
        return Surprise(file.BASE_60, sentence, f"write a plain number, or '{shown}' in quotes for text")
    if _DATE.fullmatch(text):
        return Surprise(file.DATE, f"some programs read '{shown}' as a date", f"write '{shown}' in quotes for text")
    if _NOT_FINITE.fullmatch(text):
        return Surprise(file.NOT_FINITE, f"'{shown}' is not a finite number", "write a finite one")
    if _ODD_DECIMAL.fullmatch(text):
        hint = "write digits alone, without '_', '+', leading zeros or a bare point: 1000, 0.5, -3, 1e-5"
        return Surprise(file.NOT_A_PLAIN_NUMBER, f"'{shown}' is not written as a plain decimal number", hint)
    return text


def _decimal_hint(text: str) -> str:
    if len(text) > _LONGEST_NUMBER:
        return "write it in decimal"
    digits = text.replace("_", "").lower()
    if re.fullmatch(r"[+-]?0[0-7]+", digits):
        return f"write {int(digits, 8)} if it is octal, {int(digits)} if it is not"
    return f"write {int(digits, 0)}" if re.fullmatch(r"[+-]?0[xbo][0-9a-f]+", digits) else "write it in decimal"
