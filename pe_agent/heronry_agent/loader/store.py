"""The code on the disk of one PE: two slots, and a record that says which of them counts.

    slot        a bundle, as it came; `a` or `b`
    active      the slot from which partitions import; None: the PE has no code of its own
    ready       the other slot, if it holds a bundle that was checked and not started yet
    before      what was active before, while the active code is on trial; None: there was none
    tries       how often the agent has started since the active code was; None: the code is confirmed
    has_run     whether a module of the code on trial was ever started
    floor       the highest version that was ever started; a bundle must have a higher one. The bundle that has set the
                floor may come again unless it has failed: its slot may have been damaged

    receive     check, write the other slot, then: ready          not while code on trial has run: its way back is kept;
                                                                  code that has not run makes room for higher code
    start       before := active, active := ready, tries := 0, floor := its version
    run         has_run := yes                                    before a module of the code on trial has done much
    rest        tries := 0                                        the agent lives, and the code has not run
    confirm     tries := None                                     after the trial
    revert      active := before                                  the new code has failed, and never returns
    keep        the parts that have come of a bundle are in a file of their own, until the next `receive` or `clear`
    boot        tries + 1; after MOST_TRIES starts without a confirmation: revert. A slot that is damaged is left out

Each operation ends with one replacement of the record, before which nothing has changed for a reader. So a crash at
any moment leaves the state before the operation or the one after it. The same operation may be repeated: a bundle that
is ready or active already is received and started without effect.

The record has no signature: whoever can write in this folder can also replace the agent.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from types import NoneType
from typing import Any, Self

from heronry_agent.loader.folder import Folder
from heronry_wire.bundle import MOST_BYTES, Bundle, ForeignBundleError, unpack
from heronry_wire.errors import HeronryError

MOST_TRIES = 3
MOST_KEPT = MOST_BYTES + 64  # a part is longer than its bytes
_RECORD, _MOST_RECORD = "code.json", 1 << 18
_PARTS = "parts"
_SLOTS = ("a", "b")


class StoreError(HeronryError):
    """The store cannot do what is asked of it in its present state; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class Kept:
    """A bundle in a slot."""

    name: str
    version: int
    digest: str  # SHA-256 of the bundle, hexadecimal
    images: tuple[str, ...]

    @classmethod
    def of(cls, bundle: Bundle) -> Self:
        """Return what the record says of a bundle."""
        manifest = bundle.manifest
        return cls(manifest.name, manifest.version, bundle.digest, manifest.images)


@dataclass(frozen=True, slots=True)
class State:
    """The record."""

    slots: Mapping[str, Kept]
    active: str | None = None
    ready: str | None = None
    before: str | None = None
    tries: int | None = None
    has_run: bool = False
    floor: int = 0
    floor_digest: str = ""  # of the bundle that has set the floor; empty: it has failed

    @property
    def code(self) -> Kept | None:
        """Return the bundle from which partitions import; None: there is none."""
        return None if self.active is None else self.slots[self.active]

    def to_json(self) -> str:
        """Return the record as text."""
        return json.dumps(asdict(self), sort_keys=True) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read a record; raises StoreError."""
        try:
            read: dict[str, Any] = json.loads(text)
            slots = {
                slot: Kept(
                    str(one["name"]),
                    int(one["version"]),
                    bytes.fromhex(one["digest"]).hex(),
                    tuple(map(str, one["images"])),
                )
                for slot, one in read.pop("slots").items()
            }
            state = cls(slots, **read)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise _damaged(str(error)) from error
        named = {state.active, state.ready, state.before} - {None}
        if not named <= slots.keys() <= set(_SLOTS):
            raise _damaged("it names a slot that is not there")
        if not (
            type(state.floor) is int
            and type(state.floor_digest) is str
            and type(state.tries) in (int, NoneType)
            and type(state.has_run) is bool
        ):
            raise _damaged("it has text where a number belongs")
        return state


def _damaged(why: str) -> StoreError:
    return StoreError(f"{_RECORD} is damaged ({why}); empty this folder to begin without code, and bring the code anew")


class Store:
    """The code of one PE in its folder; each operation returns the state after it, or raises OSError or StoreError."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder

    def state(self) -> State:
        """Return the present state."""
        record = self._folder.read(_RECORD, _MOST_RECORD)
        return State({}) if record is None else State.from_json(record.decode("utf-8", "replace"))

    def path(self, state: State) -> str | None:
        """Return the file from which partitions import; None: there is none."""
        return None if state.active is None else str(self._folder.path / slot_file(state.active))

    def boot(self) -> State:
        """Return the state with which an agent starts: code on trial has one try less, damaged slots are left out."""
        self._folder.make()
        state = before = self.state()
        if state.tries is not None:
            state = replace(state, tries=state.tries + 1)
            if state.tries is not None and state.tries > MOST_TRIES:
                state = reverted(state)
        for slot, kept in state.slots.items():
            content = self._folder.read(slot_file(slot), MOST_BYTES + 1)
            if content is None or hashlib.sha256(content).hexdigest() != kept.digest:
                state = _without(state, slot)
        return state if state == before else self._put(state)

    def receive(self, content: bytes, check: Callable[[Bundle], None]) -> State:
        """Check a bundle and keep it ready; raises BundleError, and whatever `check` raises."""
        self._folder.remove(_PARTS)
        state, bundle = self.state(), unpack(content)
        kept = Kept.of(bundle)
        if kept in (state.code, None if state.ready is None else state.slots[state.ready]):
            return state
        check(bundle)
        if kept.version <= state.floor and kept.digest != state.floor_digest:
            raise ForeignBundleError(
                f"its version {kept.version} is not above {state.floor}, which was started here: build a higher one"
            )
        if state.tries is not None and state.has_run:
            raise StoreError("the code on this PE is on trial: send the bundle again in a minute")
        if state.tries is not None:
            state = self._put(reverted(state))
        slot = next(slot for slot in _SLOTS if slot != state.active)
        state = self._put(_without(state, slot)) if slot in state.slots else state
        self._folder.draft(slot_file(slot), bundle.content)
        self._folder.commit(slot_file(slot))
        return self._put(replace(state, slots={**state.slots, slot: kept}, ready=slot))

    def keep(self, parts: bytes) -> None:
        """Keep what has come of a bundle."""
        self._folder.draft(_PARTS, parts)
        self._folder.commit(_PARTS)

    def kept(self) -> bytes:
        """Return what was kept of a bundle; empty: nothing."""
        return self._folder.read(_PARTS, MOST_KEPT) or b""

    def start(self) -> State:
        """Let the bundle that is ready be the active one, on trial."""
        state = self.state()
        if state.ready is None:
            if state.active is None:
                raise StoreError("there is no code to start: write a bundle into 1F50h first")
            return state
        code = state.slots[state.ready]
        state = replace(state, active=state.ready, ready=None, before=state.active, tries=0, has_run=False)
        return self._put(replace(state, floor=code.version, floor_digest=code.digest))

    def run(self) -> State:
        """Note that a module of the code on trial is started; no effect on code that is confirmed."""
        state = self.state()
        return state if state.tries is None or state.has_run else self._put(replace(state, has_run=True))

    def rest(self) -> State:
        """Note that the agent lives for a while, so that its starts were no tries of code that has not run."""
        state = self.state()
        return self._put(replace(state, tries=0)) if state.tries and not state.has_run else state

    def confirm(self) -> State:
        """Keep the active code for good."""
        return self._put(replace(self.state(), before=None, tries=None, has_run=False))

    def revert(self) -> State:
        """Let the code before the present one be active again; no effect on code that is confirmed."""
        state = self.state()
        return state if state.tries is None else self._put(reverted(state))

    def clear(self) -> State:
        """Forget the bundle that is ready, and what has come of another; the active code stays."""
        self._folder.remove(_PARTS)
        state = self.state()
        return state if state.ready is None else self._put(_without(state, state.ready))

    def _put(self, state: State) -> State:
        self._folder.draft(_RECORD, state.to_json().encode())
        self._folder.commit(_RECORD)
        return state


def reverted(state: State) -> State:
    """Return the state after the code on trial has failed."""
    assert state.active is not None
    kept = {slot: one for slot, one in state.slots.items() if slot != state.active}
    return replace(state, slots=kept, active=state.before, before=None, tries=None, has_run=False, floor_digest="")


def _without(state: State, slot: str) -> State:
    """Return the state without what is in a slot; code on trial that is left out has not failed, and may come again."""
    if state.active == slot and state.tries is not None:
        return replace(reverted(state), floor_digest=state.floor_digest)
    left = {other: one for other, one in state.slots.items() if other != slot}
    active, ready, before = (None if one == slot else one for one in (state.active, state.ready, state.before))
    return replace(state, slots=left, active=active, ready=ready, before=before)


def slot_file(slot: str) -> str:
    """Return the name of the file of a slot."""
    return f"slot-{slot}.bundle"
