"""The samples of one source: when each came, and its numbers. A NaN stands where nothing can be used: a gap."""

import math
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from typing import Any, Final

from heronry_tools.watch.data_samples import DataSource, sample_of
from heronry_wire.frame import Frame, Malformed

Document = dict[str, Any]

_KEPT_OF_A_GROUP: Final = 3  # the least, the greatest, and a gap


class Track:
    """The samples of a source, in order of time.

    refused: how many frames a PE would have refused.
    why_refused: the reason for the last of them.
    """

    def __init__(self, source: DataSource, most: int | None = None) -> None:
        """Begin without a sample; of more than `most` to twice `most` samples the oldest are dropped."""
        self.source, self._most = source, most
        self.refused, self.why_refused = 0, ""
        self._times_ns = array("q")
        self._values = [array("d") for _ in range(source.parts)]
        self._versions = array("B")
        self._dropped = 0
        self._last_head: tuple[int, int] | None = None

    @property
    def count(self) -> int:
        """Tell how many samples there have been, with those that were dropped."""
        return self._dropped + len(self._times_ns)

    def take(self, t_ns: int, frame: Frame) -> None:
        """Take a frame with the identifier of the source, which ended at `t_ns`."""
        sample = sample_of(self.source, frame)
        if isinstance(sample, Malformed):
            self.refused, self.why_refused = self.refused + 1, sample.reason
            return
        head = sample.node, sample.message_code
        if self._times_ns:
            until_ns = self._times_ns[-1] + self.source.fresh_ns
            if t_ns > until_ns:
                self._add(until_ns, (), sample.version)
            elif head == self._last_head:  # the same frame, from another bus
                return
        self._last_head = head
        self._add(t_ns, sample.numbers if sample.is_usable else (), sample.version)

    def since(self, number: int) -> Iterator[Document]:
        """Yield the samples after the first `number` samples, as a page reads them: a document for each part."""
        begin = max(0, number - self._dropped)
        return self._documents(range(begin, len(self._times_ns)))

    def between(self, from_ns: int, to_ns: int, most: int) -> Iterator[Document]:
        """Yield the samples in a span of time, as a page reads them: a document for each part.

        The samples next to the span are added, so that lines reach its edges. If there are more than `most`, only the
        least, the greatest and one gap of each group of neighbours are given.
        """
        begin = max(0, bisect_left(self._times_ns, from_ns) - 1)
        end = min(len(self._times_ns), bisect_right(self._times_ns, to_ns) + 1)
        return self._documents(range(begin, end), most)

    def _add(self, t_ns: int, numbers: Sequence[float], version: int) -> None:
        self._times_ns.append(max(t_ns, self._times_ns[-1]) if self._times_ns else t_ns)
        for part, values in enumerate(self._values):
            values.append(numbers[part] if part < len(numbers) else math.nan)
        self._versions.append(version)
        if self._most is not None and len(self._times_ns) >= 2 * self._most:
            self._dropped += self._most
            del self._times_ns[: self._most], self._versions[: self._most]
            for values in self._values:
                del values[: self._most]

    def _documents(self, span: range, most: int | None = None) -> Iterator[Document]:
        for part, values in enumerate(self._values):
            drawn = span if most is None or len(span) <= most else list(_thinned(values, span, most))
            yield {
                "producer": self.source.producer,
                "part": part,
                "t_ns": [self._times_ns[at] for at in drawn],
                "values": [None if math.isnan(values[at]) else values[at] for at in drawn],
                "versions": [self._versions[at] for at in drawn],
            }


def _thinned(values: "array[float]", span: range, most: int) -> Iterator[int]:
    size = -(-len(span) * _KEPT_OF_A_GROUP // most)
    for begin in range(span.start, span.stop, size):
        group = range(begin, min(begin + size, span.stop))
        numbers = [at for at in group if not math.isnan(values[at])]
        kept = {min(numbers, key=values.__getitem__), max(numbers, key=values.__getitem__)} if numbers else set()
        if len(numbers) < len(group):
            kept.add(next(at for at in group if math.isnan(values[at])))
        yield from sorted(kept)
