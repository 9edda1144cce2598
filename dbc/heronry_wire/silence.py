"""The detail of an EMCY with the code STALE: which input or output is silent, or is not any more (protocol rule 8)."""

from dataclasses import dataclass
from typing import Self

_OUTPUT = 0x8000  # an output is silent, and not an input
_OVER = 0x4000  # the silence is over


@dataclass(frozen=True, slots=True)
class Silence:
    """The detail of an EMCY with the code STALE: which input or output of the module is silent.

    number: of an input, the leaf in the `needs` of the module's mode, counted from 0, unwired leaves too; of an output,
        the variable in the order of the spec. 0..16383.
    is_output: an output is silent, and not an input.
    is_over: data come again.
    """

    number: int
    is_output: bool = False
    is_over: bool = False

    @property
    def detail(self) -> int:
        """The detail of the EMCY."""
        return self.number | (_OUTPUT if self.is_output else 0) | (_OVER if self.is_over else 0)

    @classmethod
    def of(cls, detail: int) -> Self:
        """Read the detail of an EMCY."""
        return cls(detail & _OVER - 1, bool(detail & _OUTPUT), bool(detail & _OVER))
