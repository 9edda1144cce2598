"""The version of the protocol, and how it may grow.

A version has two numbers:

    major  another major gives bytes another meaning. A PE and a manager of different majors do not work together: the
           identity of a PE's table covers the major (`pe_table`), so the PE stages nothing
    minor  another minor adds what an older node may ignore: an operation of CONTROL, a code of EMCY, a CANopen object,
           a field of a table with `added_in`. Nodes of different minors work together

Object 2001h:04 of a PE tells its version to people. Nothing is decided by it, since anybody may forge the answer:
what decides are the digests of slices. docs/protocol/growth.md says what is full, what is free, and what to change.
"""

from dataclasses import dataclass, field

OUTSIDE_IDENTITY = {"identity": False}  # metadata of a field that the identity of a table does not cover (`pe_table`)


@dataclass(frozen=True, slots=True, order=True)
class Version:
    """A version of the protocol: two numbers, each 0 to 65535."""

    major: int
    minor: int = field(metadata=OUTSIDE_IDENTITY)

    @property
    def number(self) -> int:
        """The version as one number of 32 bits, as an object holds it: major in the upper half, minor in the lower."""
        return self.major << 16 | self.minor

    @staticmethod
    def of_number(number: int) -> "Version":
        """Return the version that `number` gives for it."""
        return Version(number >> 16, number & 0xFFFF)

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}"


PROTOCOL = Version(1, 3)
