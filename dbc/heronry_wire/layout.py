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
    """A payload of a whole number of bytes; fields in the order in which they travel."""

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
        """Encode one value per field; raises ValueError where one does not fit its field."""
        number = 0
        for (name, shift, mask), value in zip(self._steps, values, strict=True):
            if not 0 <= value <= mask:
                raise ValueError(f"{self.name}.{name} is {value}; it holds 0 to {mask}")
            number |= value << shift
        return number.to_bytes(self.length, "big")

    def unpack(self, data: bytes) -> tuple[int, ...] | None:
        """Decode one value per field; None where `data` does not have the length of this layout."""
        if len(data) != self.length:
            return None
        return self.fields_of(data)

    def span(self, name: str) -> tuple[int, int]:
        """First byte of a field and the byte after its last, for a caller that reads this field alone.

        Raises ValueError unless the field has whole bytes. The result is two numbers because compiled code takes no
        slice as an index.
        """
        at = 0
        for field in self.fields:
            if field.name == name and at % 8 == field.bits % 8 == 0:
                return at // 8, (at + field.bits) // 8
            at += field.bits
        raise ValueError(f"{self.name} has no field {name} of whole bytes")

    def largest(self, name: str) -> int:
        """Largest number that a field holds."""
        return next(mask for field, _, mask in self._steps if field == name)

    def fields_of(self, data: bytes) -> tuple[int, ...]:
        """Decode one value per field; the caller has checked that the payload has the length of this layout."""
        number = int.from_bytes(data, "big")
        return tuple([number >> shift & mask for shift, mask in self._places])
