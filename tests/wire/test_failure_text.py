"""Texts of failures: whatever a module puts into them, a reader gets plain lines of a limited length."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.failure_text import REASON_BYTES, TRACEBACK_BYTES, plain_reason, plain_traceback


@given(st.text(max_size=400) | st.text(alphabet="\x1b\x07\n\r\u202e\U0001f600", min_size=150, max_size=2500))
def test_a_text_is_plain_and_short(text: str) -> None:
    reason, traceback = plain_reason(text), plain_traceback(text)
    assert len(reason) <= REASON_BYTES
    assert len(traceback) <= TRACEBACK_BYTES
    assert all(" " <= c <= "~" for c in reason)
    assert all(" " <= c <= "~" or c == "\n" for c in traceback)
    assert plain_reason(reason) == reason


def test_a_plain_text_stays_as_it_is() -> None:
    assert plain_reason("ValueError: no (a.py:3)") == "ValueError: no (a.py:3)"
    assert plain_traceback("Traceback:\n  a\nValueError\n") == "Traceback:\n  a\nValueError"


def test_a_long_reason_loses_its_end_and_a_long_traceback_its_beginning() -> None:
    assert plain_reason("x" * 300) == "x" * (REASON_BYTES - 3) + "..."
    long = plain_traceback("first\n" + "line\n" * 500 + "last\n")
    assert long.startswith("...")
    assert long.endswith("line\nlast")
