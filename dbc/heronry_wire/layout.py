"""Bit layouts of fixed-size payloads: one table for the codec, the DBC and the documentation.

A layout is a list of named unsigned fields, most significant bit first, as CANaerospace writes its numbers. Packing and
unpacking go through one big integer, so a field may start at any bit.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Field:
    """An unsigned number of `bits` bits; `labels` maps its values to names, where they have names."""

    name: str
    bits: int
    labels: Mapping[int, str] | None = None
    unit: str = ""


class Layout:
    """A payload of a whole number of bytes, as a list of fields in the order in which they are sent."""

    def __init__(self, name: str, *fields: Field) -> None:
        total = sum(field.bits for field in fields)
        if total % 8 or total > 64:
            raise ValueError(f"layout {name} has {total} bits; a CAN payload has a multiple of 8, at most 64")
        self.name = name
        self.fields = fields
        self.length = total // 8  # bytes
        shift = total
        steps = []
        for field in fields:
            shift -= field.bits
            steps.append((field.name, shift, (1 << field.bits) - 1))
        self._steps = tuple(steps)
        self._places = tuple((shift, mask) for _, shift, mask in steps)

    def pack(self, *values: int) -> bytes:
        """Encode a payload from one value per field, in order.

        Raises ValueError where a value does not fit its field.
        """
        number = 0
        for (name, shift, mask), value in zip(self._steps, values, strict=True):
            if not 0 <= value <= mask:
                raise ValueError(f"{self.name}.{name} is {value}; it must be 0 to {mask}")
            number |= value << shift
        return number.to_bytes(self.length, "big")

    def unpack(self, data: bytes) -> tuple[int, ...] | None:
        """Decode a payload into one value per field; None where `data` does not have the length of this layout."""
        if len(data) != self.length:
            return None
        return self.fields_of(data)

    def span(self, name: str) -> tuple[int, int]:
        """Return the first byte of a field and the byte after its last, by which a caller can read this field alone.

        Raises ValueError if the field does not consist of whole bytes.
        """
        at = 0
        for field in self.fields:
            if field.name == name and at % 8 == field.bits % 8 == 0:
                return at // 8, (at + field.bits) // 8
            at += field.bits
        raise ValueError(f"{self.name} has no field '{name}' that consists of whole bytes")

    def largest(self, name: str) -> int:
        """Return the largest number that a field can hold."""
        return next(mask for field, _, mask in self._steps if field == name)

    def fields_of(self, data: bytes) -> tuple[int, ...]:
        """Decode a payload that has the length of this layout into one value per field."""
        number = int.from_bytes(data, "big")
        return tuple([number >> shift & mask for shift, mask in self._places])
