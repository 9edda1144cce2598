"""The keeper: a process that does one operation of the store and ends, so that the agent never waits for a disk.

    python -m heronry_agent.loader.keeper FOLDER OPERATION [PUBLIC_KEY]      started by the agent

OPERATION is an operation of the store. A bundle to receive, or parts to keep, come on standard input. Without
PUBLIC_KEY a bundle need not be signed. The answer is one line of JSON on standard output, an `Answer`.

If the keeper is killed, the store has the state before the operation or the one after it; the agent asks which (`boot`
does not count a try in one that is not on trial, and `state` never does).
"""

import json
import sys
from base64 import b64encode
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from heronry_agent.loader.folder import Folder
from heronry_agent.loader.store import MOST_KEPT, State, Store
from heronry_wire.bundle import Bundle, ForeignBundleError, LargeBundleError
from heronry_wire.errors import HeronryError

FINE, NOT_FOR_HERE, TOO_LARGE, WRONG, DISK = "", "not for here", "too large", "wrong", "disk"
"""Why an operation was not done: the bundle is not for this PE, too large or damaged; or the disk does not take it."""

OPERATIONS = ("boot", "state", "receive", "keep", "start", "run", "rest", "confirm", "revert", "clear")


class Answer(NamedTuple):
    """What has become of an operation."""

    problem: str
    sentence: str
    state: str | None  # the record; None where it cannot be read
    path: str | None  # of the active slot
    kept: str = ""  # what was kept of an unfinished bundle, in base64; `boot` alone tells it

    def to_json(self) -> str:
        """Return the answer as one line."""
        return json.dumps(self._asdict())


def answer(folder: Path, operation: str, content: bytes, key: Path | None) -> Answer:
    """Do one operation; returns what has become of it."""
    store = Store(Folder(folder))
    problem, sentence = FINE, ""
    try:
        if operation == "receive":
            store.receive(content, lambda bundle: _check(bundle, key))
        elif operation == "keep":
            store.keep(content)
        else:
            getattr(store, operation)()
    except OSError as error:
        problem = DISK
        sentence = f"{error.filename or folder}: {error.strerror}; the code stays as it was: make room, or name another"
    except ForeignBundleError as error:
        problem, sentence = NOT_FOR_HERE, str(error)
    except LargeBundleError as error:
        problem, sentence = TOO_LARGE, str(error)
    except HeronryError as error:
        problem, sentence = WRONG, str(error)
    state = _state(store)
    if state is None:
        return Answer(problem, sentence, None, None)
    kept = _kept(store) if operation == "boot" else b""
    return Answer(problem, sentence, state.to_json(), store.path(state), b64encode(kept).decode())


def _check(bundle: Bundle, key: Path | None) -> None:
    from heronry_wire import bundle_needs  # noqa: PLC0415 - other operations do without it

    if key is not None:
        from heronry_wire import bundle_signing  # noqa: PLC0415 - takes 8 MB, and its extra is not there without a key

        bundle_signing.check_signature(bundle, bundle_signing.read_public_key(key))
    bundle_needs.check_here(bundle.manifest)


def _state(store: Store) -> State | None:
    try:
        return store.state()
    except (OSError, HeronryError):
        return None


def _kept(store: Store) -> bytes:
    with suppress(OSError):
        return store.kept()
    return b""


def main(arguments: list[str]) -> int:
    """Do one operation and print the answer; returns the exit code."""
    folder, operation, *key = arguments
    content = sys.stdin.buffer.read(MOST_KEPT) if operation in ("receive", "keep") else b""
    print(answer(Path(folder), operation, content, Path(key[0]) if key else None).to_json(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
