"""The loader's store: whatever is killed, and whenever, it holds the old code or the new code, whole.

The judge is independent of the store: a slot is whole if it has the bytes of a bundle that was sent, and the state is
one that the model of this file allows before or after the operation that was cut short.
"""

import errno
import json
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test

import heronry_wire
from agent.loader_bundles import bundle, signed, signing_key
from heronry_agent.loader.folder import Folder
from heronry_agent.loader.keeper import DISK, FINE, NOT_FOR_HERE, TOO_LARGE, WRONG, answer
from heronry_agent.loader.store import MOST_TRIES, State, Store, StoreError
from heronry_wire.bundle import MOST_BYTES, Bundle, BundleError, ForeignBundleError
from thoroughness import mostly_soak, part_of


def believe(_: Bundle) -> None:
    """Check nothing of a bundle."""


class CutShort(BaseException):
    """The process dies here."""


class Cutting(Folder):
    """A folder whose process dies at the file operation number `at`, before it, in its middle or after it."""

    def __init__(self, path: Path, at: int = 1 << 30) -> None:
        super().__init__(path)
        self.at, self.done = at, 0

    def draft(self, name: str, content: bytes) -> None:
        for part in (0, 1, len(content) // 2, len(content) - 1):
            self._point(lambda part=part: super(Cutting, self).draft(name, content[:part]))
        super().draft(name, content)
        self._point()

    def commit(self, name: str) -> None:
        self._point()
        super().commit(name)
        self._point()

    def _point(self, first=lambda: None) -> None:
        self.done += 1
        if self.done > self.at:
            first()
            raise CutShort


def code(path: Path) -> tuple[str, ...]:
    """What runs after a start of the agent: the version, and whether it is on trial; it must be whole."""
    store = Store(Folder(path))
    state = store.boot()
    for slot, kept in state.slots.items():
        content = (path / f"slot-{slot}.bundle").read_bytes()
        assert content == bundle(kept.version).content, "a slot that counts is not what was sent"
    run = store.path(state)
    assert (run is None) is (state.active is None)
    return ("none",) if state.code is None else (str(state.code.version), "kept" if state.tries is None else "on trial")


def prepared(path: Path) -> Store:
    """A store with version 1, kept."""
    store = Store(Folder(path))
    store.boot()
    store.receive(bundle(1).content, believe)
    store.start()
    store.confirm()
    return store


OLD, NEW = ("1", "kept"), ("2", "on trial")
OPERATIONS = {
    "receive": (Store.state, lambda s: s.receive(bundle(2).content, believe), {OLD}),
    "start": (lambda s: s.receive(bundle(2).content, believe), lambda s: s.start(), {OLD, NEW}),
    "confirm": (
        lambda s: (s.receive(bundle(2).content, believe), s.start()),
        lambda s: s.confirm(),
        {NEW, ("2", "kept")},
    ),
    "revert": (lambda s: (s.receive(bundle(2).content, believe), s.start()), lambda s: s.revert(), {NEW, OLD}),
    "boot": (
        lambda s: (s.receive(bundle(2).content, believe), s.start()),
        lambda s: s.boot(),
        {NEW, OLD},
    ),  # OLD: the last try
    "clear": (lambda s: s.receive(bundle(2).content, believe), lambda s: s.clear(), {OLD}),
    "keep": (Store.state, lambda s: s.keep(b"some parts"), {OLD}),
    "receive what was kept": (
        lambda s: s.keep(bundle(2).content[:-1]),
        lambda s: s.receive(bundle(2).content, believe),
        {OLD},
    ),
    "receive again": (
        lambda s: s.receive(bundle(2).content, believe),
        lambda s: s.receive(bundle(3).content, believe),
        {OLD},
    ),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_a_crash_at_any_file_operation_leaves_the_old_or_the_new_code_whole(name: str, tmp_path: Path) -> None:
    before, operation, allowed = OPERATIONS[name]
    found, at = set(), 0
    while True:
        path = tmp_path / str(at)
        before(prepared(path))
        with suppress(CutShort):
            operation(Store(Cutting(path, at)))
            break
        now = code(path)
        assert now in allowed
        found.add(now)
        with suppress(StoreError):  # and what was cut short can be done again
            operation(Store(Folder(path)))
        again = code(path)
        assert again in allowed
        found.add(again)
        at += 1
    assert at >= 7  # the file operations of one replacement
    assert code(path) in allowed
    assert found == allowed


def test_versions_only_rise_and_what_has_failed_never_comes_back(tmp_path: Path) -> None:
    store = prepared(tmp_path)
    with pytest.raises(ForeignBundleError, match="its version 1 is not above 1"):
        store.receive(bundle(1, 512).content, believe)
    store.receive(bundle(3).content, believe)
    store.start()
    store.run()
    assert code(tmp_path) == ("3", "on trial")
    with pytest.raises(StoreError, match="on trial"):
        store.receive(bundle(4).content, believe)
    assert store.revert().floor == 3
    assert code(tmp_path) == OLD
    for version in (2, 3):
        with pytest.raises(ForeignBundleError, match="is not above 3"):
            store.receive(bundle(version).content, believe)
    store.receive(bundle(4).content, believe)
    assert store.start().code.version == 4


def test_what_is_there_already_is_received_without_effect(tmp_path: Path) -> None:
    store = prepared(tmp_path)
    assert store.receive(bundle(1).content, believe) == store.state()
    state = store.receive(bundle(2).content, believe)
    assert store.receive(bundle(2).content, believe) == state
    assert store.start() == store.start()
    store.confirm()
    assert store.revert() == store.state()


def test_code_that_kills_its_agent_is_given_up_after_some_starts(tmp_path: Path) -> None:
    store = prepared(tmp_path)
    store.receive(bundle(2).content, believe)
    store.start()
    assert [code(tmp_path) for _ in range(MOST_TRIES + 1)] == [NEW] * MOST_TRIES + [OLD]


def test_code_on_trial_that_no_plan_runs_is_neither_banned_nor_in_the_way(tmp_path: Path) -> None:
    store = prepared(tmp_path)
    store.receive(bundle(2).content, believe)
    store.start()
    for _ in range(2 * MOST_TRIES):
        assert code(tmp_path) == NEW
        store.rest()
    store.receive(bundle(4).content, believe)
    assert code(tmp_path) == OLD
    assert store.start().code.version == 4
    store.run()
    assert [code(tmp_path) for _ in range(MOST_TRIES + 1)] == [("4", "on trial")] * MOST_TRIES + [OLD]


def test_code_on_trial_whose_slot_the_disk_has_damaged_may_come_again(tmp_path: Path) -> None:
    store = prepared(tmp_path)
    store.receive(bundle(2).content, believe)
    store.start()
    (tmp_path / "slot-b.bundle").write_bytes(b"?")
    assert code(tmp_path) == OLD
    store.receive(bundle(2).content, believe)
    assert store.start().code.version == 2


def test_first_code_that_fails_leaves_a_pe_without_code(tmp_path: Path) -> None:
    store = Store(Folder(tmp_path))
    store.boot()
    with pytest.raises(StoreError, match="there is no code to start"):
        store.start()
    store.receive(bundle(1).content, believe)
    store.start()
    assert store.revert().code is None
    assert code(tmp_path) == ("none",)


@pytest.mark.parametrize("slot", ["a", "b"])
def test_a_slot_that_the_disk_has_damaged_is_not_run_and_may_be_sent_again(slot: str, tmp_path: Path) -> None:
    store = prepared(tmp_path)
    store.receive(bundle(2).content, believe)
    store.start()
    file = tmp_path / f"slot-{slot}.bundle"
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    assert code(tmp_path) in (("none",), NEW, OLD)
    assert code(tmp_path) == (OLD if store.state().code.version == 1 else NEW)
    kept = prepared(tmp_path / "other")
    (tmp_path / "other/slot-a.bundle").unlink()
    assert code(tmp_path / "other") == ("none",)
    kept.receive(bundle(1).content, believe)
    kept.start()
    assert code(tmp_path / "other") == ("1", "on trial")


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", '{"slots": []}', '{"slots": {"c": {}}}', '{"slots": {}, "active": "a"}', "[" * 100_000),
        *(
            '{"slots": {}, "tries": "x"}',
            '{"slots": {}, "has_run": 1}',
            '{"slots": {}, "floor": "1"}',
            '{"slots": {}, "more": 1}',
            '{"slots": {"a": {"name": "n", "version": 1, "digest": "no digits", "images": []}}}',
        ),
    ],
)
def test_a_damaged_record_is_told_in_one_sentence(text: str, tmp_path: Path) -> None:
    (tmp_path / "code.json").write_text(text)
    with pytest.raises(StoreError, match=r"code\.json is damaged .* empty this folder"):
        Store(Folder(tmp_path)).boot()
    said = answer(tmp_path, "boot", b"", None)
    assert (said.problem, said.state, said.path, said.kept) == (WRONG, None, None, "")


class Anything(RuleBasedStateMachine):
    """Any order of operations: what runs is what the model says."""

    root: Path

    @initialize()
    def begin(self) -> None:
        self.path = Path(mkdtemp(dir=Anything.root))
        self.store = Store(Folder(self.path))
        self.store.boot()
        self.run: int | None = None
        self.old: int | None = None
        self.ready: int | None = None
        self.tries: int | None = None
        self.floor, self.failed, self.has_run = 0, True, False

    @rule(version=st.integers(1, 8))
    def receive(self, version: int) -> None:
        taken = False
        with suppress(StoreError, BundleError):
            self.store.receive(bundle(version).content, believe)
            taken = True
        is_there = version in (self.run, self.ready)
        is_higher = version > self.floor or (version == self.floor and not self.failed)
        assert taken is (is_there or (is_higher and not (self.tries is not None and self.has_run)))
        if taken and not is_there:
            if self.tries is not None:
                self._back()
            self.ready = version

    @rule()
    def start(self) -> None:
        with suppress(StoreError):
            self.store.start()
        if self.ready is not None:
            self.old, self.run, self.ready, self.tries = self.run, self.ready, None, 0
            self.floor, self.failed, self.has_run = self.run, False, False

    @rule()
    def first_start_of_a_module(self) -> None:
        self.store.run()
        self.has_run = self.tries is not None

    @rule()
    def rest(self) -> None:
        self.store.rest()
        if self.tries is not None and not self.has_run:
            self.tries = 0

    @precondition(lambda self: self.tries is not None)
    @rule()
    def confirm(self) -> None:
        self.store.confirm()
        self.tries = self.old = None

    @rule()
    def revert(self) -> None:
        self.store.revert()
        self._back()

    def _back(self) -> None:
        if self.tries is not None:
            self.run, self.old, self.tries, self.failed = self.old, None, None, True

    @rule()
    def boot(self) -> None:
        if self.tries is not None:
            self.tries += 1
            if self.tries > MOST_TRIES:
                self._back()
        expected = ("none",) if self.run is None else (str(self.run), "kept" if self.tries is None else "on trial")
        assert code(self.path) == expected

    @rule()
    def clear(self) -> None:
        self.store.clear()
        self.ready = None


def test_any_order_of_operations(tmp_path: Path) -> None:
    Anything.root = tmp_path
    run_state_machine_as_test(
        Anything, settings=settings(max_examples=part_of(60), deadline=None, suppress_health_check=list(HealthCheck))
    )


# The keeper: the process that works on the store


def keep(path: Path, operation: str, content: bytes = b"", key: Path | None = None):
    command = [sys.executable, "-m", "heronry_agent.loader.keeper", str(path), operation, *([str(key)] if key else [])]
    done = subprocess.run(command, input=content, capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_keeper_checks_what_comes_and_says_what_is_wrong(tmp_path: Path) -> None:
    key = signing_key(tmp_path)
    public, path = key.with_name(f"{key.name}.pub"), tmp_path / "code"
    (tmp_path / "other").mkdir()
    other = signing_key(tmp_path / "other")
    content = signed(key, 1).content
    flipped = content[:200] + bytes((content[200] ^ 4,)) + content[201:]
    cases = [
        (bundle(1).content, NOT_FOR_HERE, "it is not signed"),
        (signed(other, 1).content, NOT_FOR_HERE, "it is signed with the key"),
        (flipped, WRONG, "its archive is damaged"),
        (bytes(MOST_BYTES + 1), TOO_LARGE, "at most 1048576"),
        (content, FINE, ""),
    ]
    for sent, problem, sentence in cases:
        told = answer(path, "boot", b"", public) and answer(path, "receive", sent, public)
        assert told.problem == problem
        assert sentence in told.sentence
        assert "\n" not in told.sentence
    assert keep(path, "start", key=public)["path"] == str(path / "slot-a.bundle")
    answer(path, "run", b"", None)
    assert answer(path, "receive", bundle(2).content, None).problem == WRONG  # the first code is on trial
    answer(path, "confirm", b"", None)
    assert answer(path, "receive", bundle(2).content, None).problem == FINE  # without a key unsigned code is taken


def test_code_that_need_not_be_signed_comes_without_the_package_that_checks_signatures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [one for one in sys.modules if one.split(".")[0] == "cryptography"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "heronry_wire.bundle_signing", raising=False)
    monkeypatch.delattr(heronry_wire, "bundle_signing", raising=False)
    assert answer(tmp_path, "receive", bundle(1).content, None).problem == FINE
    with pytest.raises(ImportError):
        answer(tmp_path, "receive", bundle(2).content, tmp_path / "key")


class Full(Folder):
    def draft(self, name: str, content: bytes) -> None:  # noqa: ARG002
        raise OSError(errno.ENOSPC, "No space left on device", str(self.path / name))


def test_a_disk_that_takes_nothing_is_one_sentence_and_nothing_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared(tmp_path)
    monkeypatch.setattr("heronry_agent.loader.keeper.Folder", Full)
    told = answer(tmp_path, "receive", bundle(2).content, None)
    assert told.problem == DISK
    assert told.sentence.startswith(f"{tmp_path}/slot-b.bundle: No space left on device; the code stays as it was")
    assert State.from_json(told.state).code.version == 1
    file = tmp_path / "code.json"
    assert answer(file, "boot", b"", None).problem == DISK  # a file where the folder should be


@pytest.mark.parametrize("moments", mostly_soak([8, 50], [8]))
def test_a_keeper_that_is_killed_at_any_moment_leaves_the_old_or_the_new_code_whole(
    moments: int, tmp_path: Path
) -> None:
    prepared(tmp_path / "whole")
    began = time.monotonic()
    assert keep(tmp_path / "whole", "receive", bundle(2).content)["problem"] == FINE
    took_s = time.monotonic() - began
    found = set()
    for number in range(moments):
        path = tmp_path / str(number)
        store = prepared(path)
        if number % 2:
            store.receive(bundle(2).content, believe)
        operation, content = ("start", b"") if number % 2 else ("receive", bundle(2).content)
        command = [sys.executable, "-m", "heronry_agent.loader.keeper", str(path), operation]
        keeper = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with suppress(BrokenPipeError), keeper.stdin as stream:
            stream.write(content)
        with suppress(subprocess.TimeoutExpired):
            keeper.wait(took_s * (0.6 + 0.6 * number / moments))
        keeper.send_signal(signal.SIGKILL)
        keeper.wait()
        now = code(path)
        assert now in (OLD, NEW)
        found.add(now)
        keep(path, "receive", bundle(2).content)
        with suppress(StoreError):
            store.start()
        assert code(path) == NEW
    assert OLD in found
