"""Events of a manager's process, read from a real pipe."""

import os

from heronry_tools.demo.event_stream import EventStream


def test_an_event_is_given_when_its_line_is_whole_and_the_end_is_noticed() -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe:
        events = EventStream(pipe)
        assert events.take() == []
        os.write(writing, b'{"event": "one"}\n{"event": "two"}\n{"eve')
        assert events.take() == [{"event": "one"}, {"event": "two"}]
        assert events.take() == []
        os.write(writing, b'nt": "three"}\n')
        assert events.take(wait_s=10) == [{"event": "three"}]
        assert not events.has_ended
        os.close(writing)
        assert events.take(wait_s=10) == []
        assert events.has_ended
