"""Pictures for the ground: `Imaging` sends a thumbnail as a stream of words, `ImageArchive` puts it together again.

A word has 32 bits: an index (8 bits) and a payload (24 bits).

    word 0 to 3     the head: the number of the picture, then latitude, longitude and altitude of the camera. Latitude
                    and longitude are (degrees + 256) * 32768, the altitude is in m; 0xFFFFFF means unknown
    other words     three grey pixels each. Mode `preview` sends every fourth of these words, for a coarser picture

The camera of the plant gives only a counter. The pixels are a pattern that is computed from the counter, so that
`ImageArchive` can verify what has arrived. A lost word spoils only its own picture: the next picture starts again at
index 0.

After a restart, `Imaging` begins a new picture, with the present count of the camera. The counts of `ImageArchive`
begin at 0 after a restart.
"""

from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number, whole

WORDS = 64
HEAD_WORDS = 4
PREVIEW_STRIDE = 4
_PAYLOAD_MASK = 0xFF_FFFF
_DEGREES_SHIFT = 256.0
_PER_DEGREE = 32_768.0


def pixel_word(frame: int, index: int) -> int:
    """Return the payload (24 bits: three grey pixels) of the test pattern at `index` of the picture `frame`."""
    return (frame * 2_654_435_761 + index * 40_503) & _PAYLOAD_MASK


def word(index: int, payload: int) -> int:
    """Return the 32-bit word with this index and payload."""
    return index << 24 | payload & _PAYLOAD_MASK


class Imaging(Module):
    """Sends the latest picture, one word per period, in mode `full` or `preview`."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        stride = 1 if ctx.mode == "full" else PREVIEW_STRIDE
        self._indices = (*range(HEAD_WORDS), *range(HEAD_WORDS, WORDS, stride))
        self._next = 0
        self._frame = 0
        self._head = [0] * HEAD_WORDS

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the next word of the picture.

        A new picture begins only when the frame count of the camera is present; until then nothing is published.
        """
        if self._next == 0:
            frame = whole(inputs, "frame_count")
            if frame is None:
                return {}
            self._frame, self._head = frame, _head(frame, inputs)
        index = self._indices[self._next]
        self._next = (self._next + 1) % len(self._indices)
        payload = self._head[index] if index < HEAD_WORDS else pixel_word(self._frame, index)
        return {"image_data": word(index, payload)}


def _head(frame: int, inputs: Inputs) -> list[int]:
    latitude, longitude = number(inputs, "gps_latitude"), number(inputs, "gps_longitude")
    altitude_m = number(inputs, "altitude")
    height = _PAYLOAD_MASK if altitude_m is None else min(max(round(altitude_m), 0), _PAYLOAD_MASK - 1)
    return [frame & _PAYLOAD_MASK, _place(latitude), _place(longitude), height]


def _place(degrees: float | None) -> int:
    return _PAYLOAD_MASK if degrees is None else round((degrees + _DEGREES_SHIFT) * _PER_DEGREE) & _PAYLOAD_MASK


class ImageArchive(Module):
    """Puts the received pictures together, and counts them in `whole_frames` and `spoilt_frames`."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self.whole_frames = 0
        self.spoilt_frames = 0
        self._frame = 0
        self._sound = False
        self._last_index = -1

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Take the received word of a picture, unless it has the same index as the word before."""
        received = whole(inputs, "image_data")
        if received is not None and received >> 24 != self._last_index:
            self._take(received >> 24, received & _PAYLOAD_MASK)
        return {}

    def _take(self, index: int, payload: int) -> None:
        if index == 0:
            self.spoilt_frames += self._sound  # the picture before is incomplete
            self._frame, self._sound = payload, True
        elif self._sound and not self._continues(index, payload):
            self._sound = False
            self.spoilt_frames += 1
        elif self._sound and index + PREVIEW_STRIDE > WORDS - 1 and self._ends(index):
            self.whole_frames += 1
            self._sound = False
        self._last_index = index

    def _continues(self, index: int, payload: int) -> bool:
        step = index - self._last_index
        in_step = step == 1 or (step == PREVIEW_STRIDE and index > HEAD_WORDS)
        return in_step and (index < HEAD_WORDS or payload == pixel_word(self._frame, index))

    def _ends(self, index: int) -> bool:
        """Tell whether a word is the last one of its picture, full or preview."""
        return index == WORDS - 1 or index - self._last_index == PREVIEW_STRIDE
