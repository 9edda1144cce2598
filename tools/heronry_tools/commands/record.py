"""`heronry record`: a flight recorder, which writes the frames and events of a flight into rotating files."""

import argparse
import select
import time

from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import spec_path
from heronry_tools.sources.opened import opened_feed
from heronry_tools.watch.recorder import LEAST_BYTES, Recorder
from heronry_wire.interruption import noted


def run(arguments: argparse.Namespace) -> int:
    """Record until a signal comes, or until the time of --for is over; returns 0."""
    if arguments.limit < LEAST_BYTES:
        raise UserError(
            f"--limit {arguments.limit} bytes is too small; the least is {LEAST_BYTES // 10**6}M (megabytes)"
        )
    feed = opened_feed(arguments)
    stopped = noted()
    end_s = None if arguments.seconds is None else time.monotonic() + arguments.seconds
    text = (feed.spec_file or spec_path(arguments.spec)).read_bytes()
    try:
        recorder = Recorder(arguments.folder, feed.spec, feed.source, text, arguments.limit)
        print(f"recording {feed.spec.name} into {arguments.folder}; Ctrl-C ends it", flush=True)
        begun_s, frames, count = time.monotonic(), 0, 0
        try:
            while not stopped and (end_s is None or time.monotonic() < end_s):
                select.select(feed.readers(), [], [], 0.1)
                events = feed.poll()
                recorder.write(feed.frames, events)
                frames, count = frames + len(feed.frames), count + len(events)
        finally:
            recorder.close()
        ended = "ended by a signal" if stopped else "the time is up"
        spent_s = time.monotonic() - begun_s
        print(f"{ended}: {arguments.folder} has the frames ({frames}) and events ({count}) of {spent_s:.0f} s")
    finally:
        feed.close()
    return 0
