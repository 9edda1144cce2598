"""The exact length of a frame, bit by bit. Stands in until the wire package has its table-driven one."""

from heronry_wire.frame import Frame


def exact_frame_bits(frame: Frame) -> int:
    """Return the bits of a frame on the wire: stuff bits as they fall, and the intermission."""
    if frame.extended:
        head = [0, *_b(frame.can_id >> 18, 11), 1, 1, *_b(frame.can_id & 0x3FFFF, 18), frame.remote, 0, 0]
    else:
        head = [0, *_b(frame.can_id, 11), frame.remote, 0, 0]
    bits = [*head, *_b(len(frame.data), 4)]
    for byte in frame.data:
        bits += _b(byte, 8)
    crc = 0
    for bit in bits:
        top = bool(bit) ^ (crc >> 14 & 1)
        crc = crc << 1 & 0x7FFF
        if top:
            crc ^= 0x4599
    bits += _b(crc, 15)
    run, last, stuffed = 0, None, 0
    for bit in map(bool, bits):
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed += 1
            last, run = not bit, 1
    return len(bits) + stuffed + 13


def _b(value: int, count: int) -> list[int]:
    return [value >> i & 1 for i in reversed(range(count))]
