"""The loader of a PE against a model, while keepers answer late, fail, die and find the disk full, in any order.

The store, the keeper's operations and the trial are the real ones; only the process is replaced, by `LateKeeper`, which
does its operation when the test says so. The model knows what has failed and what was kept; it never asks the loader.
"""

from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from agent.loader_bundles import IMAGE, bundle
from heronry_agent.core.vocabulary import (
    ControlProgram,
    ImagesArrived,
    ImagesMissing,
    ProgramChanged,
    StartModule,
    StepFailed,
    Stepped,
    StopModule,
    WriteProgram,
)
from heronry_agent.loader.code_loader import REST_NS, RETRY_NS, CodeLoader
from heronry_agent.loader.folder import Folder
from heronry_agent.loader.keeper import DISK, Answer, answer
from heronry_agent.loader.keeper_process import KEEPER_NS, LOST, KeeperProcess
from heronry_agent.loader.store import Store
from heronry_agent.loader.trial import GAP_NS, TRIAL_NS
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import NEVER_NS
from thoroughness import part_of

M = 4
ENTRY = ModuleEntry(M, "probe", IMAGE, None, demux=False, movable=False, modes=(), partition="p+")


class LateKeeper(KeeperProcess):
    """A keeper that does its operation when `answer` is called."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, None)
        self.folder = folder
        self.work: tuple[str, bytes] | None = None
        self.said: Answer | None = None

    def boot(self) -> Answer:
        return answer(self.folder, "boot", b"", None)

    def begin(self, operation: str, content: bytes, now_ns: int) -> None:
        assert self.work is None, "one keeper at a time"
        self.work, self.said, self.next_ns = (operation, content), None, now_ns + KEEPER_NS

    def answer(self, how: str) -> str:
        """Let the keeper end; returns its operation."""
        assert self.work is not None
        operation, content = self.work
        if how == "disk":
            self.said = answer(self.folder, "state", b"", None)._replace(problem=DISK, sentence="the disk is full")
        elif how == "dies at once":
            self.said = LOST
        else:
            self.said = answer(self.folder, operation, content, None)
            self.said = LOST if how == "dies at the end" else self.said
        return operation

    def heard(self, ready, now_ns: int) -> Answer | None:  # noqa: ARG002
        said, self.said = self.said, None
        if said is not None:
            self.work, self.next_ns = None, NEVER_NS
        return said


class Pe:
    """A loader, and what the core of its PE knows by its events."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.keeper, self.now_ns, self.log = folder, LateKeeper(folder), 0, []
        self.loader = CodeLoader(folder, self.keeper, {M: ENTRY}, self.log.append)
        self.program, self.images = self.loader.program, set(self.loader.images)

    @property
    def version(self) -> int:
        return self.program.version

    def take(self, events) -> None:
        for event in events:
            if isinstance(event, ProgramChanged):
                self.program = event.state
            elif isinstance(event, ImagesArrived):
                self.images |= event.images
            elif isinstance(event, ImagesMissing):
                self.images -= event.images.keys()

    def order(self, action) -> None:
        self.take(self.loader.ordered(action, self.now_ns))

    def wait(self, ns: int) -> None:
        self.now_ns += ns
        self.take(self.loader.take((), self.now_ns))

    def answer(self, how: str = "fine") -> str:
        operation = self.keeper.answer(how)
        self.wait(0)
        return operation

    def bring(self, version: int) -> None:
        """Let code come and start."""
        self.order(WriteProgram(bundle(version).content))
        self.answer()
        self.order(ControlProgram(is_start=True))
        self.answer()

    def run(self) -> None:
        """Let the module answer steps for longer than a trial lasts."""
        for _ in range(TRIAL_NS // GAP_NS + 2):
            self.now_ns += GAP_NS
            self.take(self.loader.heard(Stepped(M, 0, {}), self.now_ns))

    def fail(self) -> None:
        self.take(self.loader.heard(StepFailed(M, 0, "it raises"), self.now_ns))

    def on_disk(self):
        return Store(Folder(self.folder)).state()


@pytest.fixture
def pe(tmp_path: Path) -> Pe:
    """A PE with version 1, kept."""
    pe = Pe(tmp_path)
    pe.bring(1)
    pe.run()
    assert pe.answer() == "confirm"
    return pe


@pytest.mark.parametrize("first", [False, True])
def test_code_that_fails_while_a_keeper_works_never_returns(first: bool, pe: Pe, tmp_path: Path) -> None:
    if first:
        pe = Pe(tmp_path / "new")
    pe.bring(2)
    pe.order(WriteProgram(bundle(3).content))
    pe.fail()
    assert pe.version == (0 if first else 1)
    assert pe.program.is_at_work  # the order is not answered
    assert pe.answer() == "receive"  # from a record that has version 2 in use
    assert pe.version == (0 if first else 1)
    assert not pe.program.is_at_work
    pe.fail()
    assert pe.version == (0 if first else 1)
    assert pe.answer() == "revert"
    assert pe.on_disk().floor_digest == ""
    pe.fail()
    assert pe.version == (0 if first else 1)


def test_what_the_disk_owes_is_asked_for_again_and_nothing_else(pe: Pe) -> None:
    pe.bring(2)
    pe.fail()
    assert pe.answer("disk") == "revert"
    pe.wait(RETRY_NS - 1)
    assert pe.keeper.work is None
    pe.wait(1)
    assert pe.answer("dies at once") == "revert"
    pe.wait(RETRY_NS)
    assert pe.answer() == "revert"
    pe.wait(RETRY_NS)
    assert pe.keeper.work is None
    assert (pe.version, pe.loader.next_ns) == (1, NEVER_NS)
    pe.bring(3)
    pe.run()
    assert pe.answer("disk") == "confirm"
    pe.wait(RETRY_NS)
    assert pe.answer() == "confirm"
    assert (pe.version, pe.on_disk().tries, pe.loader.next_ns) == (3, None, NEVER_NS)


def test_code_that_is_not_started_is_no_try_and_makes_room(pe: Pe) -> None:
    pe.bring(2)
    pe = Pe(pe.folder)
    assert pe.on_disk().tries == 1
    pe.wait(0)
    pe.wait(REST_NS - 1)
    assert pe.keeper.work is None
    pe.wait(1)
    assert (pe.answer(), pe.on_disk().tries) == ("rest", 0)
    assert pe.loader.next_ns == NEVER_NS
    pe.bring(3)
    assert pe.version == 3
    pe.order(StartModule(M, ENTRY, 0))
    assert pe.answer("disk") == "run"
    pe.wait(RETRY_NS)
    assert (pe.answer(), pe.on_disk().has_run) == ("run", True)
    pe.order(StopModule(M))
    pe.order(WriteProgram(bundle(4).content))
    pe.answer()
    assert (pe.version, pe.program.error) == (3, 3)


ANSWERS = st.sampled_from(["fine", "fine", "fine", "disk", "dies at once", "dies at the end"])


class Anything(RuleBasedStateMachine):
    """Any order of orders, answers, steps, failures and restarts."""

    root: Path

    @initialize()
    def begin(self) -> None:
        self.folder = Path(mkdtemp(dir=Anything.root))
        self.version = self.before = 0
        self.on_trial = self.passed = False
        self.failed: set[int] = set()
        self.next = 1
        self.pe = Pe(self.folder)

    @rule(new=st.booleans())
    def receive(self, new: bool) -> None:
        self.next += new
        self.pe.order(WriteProgram(bundle(self.next).content))

    @rule(is_start=st.sampled_from([True, True, False]))
    def control(self, is_start: bool) -> None:
        self.pe.order(ControlProgram(is_start=is_start))

    @precondition(lambda self: self.pe.keeper.work is not None)
    @rule(how=ANSWERS)
    def answered(self, how: str) -> None:
        self.pe.answer(how)
        if how.startswith("dies"):
            return
        record = self.pe.on_disk()
        found = 0 if record.code is None else record.code.version
        if found not in self.failed:
            self.on_trial = record.tries is not None
            self.passed = self.passed and self.on_trial
            self.before = 0 if record.before is None else record.slots[record.before].version
            self.version = found

    @rule(starts=st.booleans())
    def module(self, starts: bool) -> None:
        self.pe.order(StartModule(M, ENTRY, 0) if starts else StopModule(M))

    @rule()
    def runs(self) -> None:
        self.pe.run()
        self.passed = self.on_trial

    @rule()
    def fails(self) -> None:
        self.pe.fail()
        if self.on_trial and not self.passed:
            self.failed.add(self.version)
            self.version, self.on_trial = self.before, False

    @rule(ns=st.sampled_from([1, RETRY_NS, REST_NS]))
    def wait(self, ns: int) -> None:
        self.pe.wait(ns)

    @rule()
    def restart(self) -> None:
        """What the disk does not have is forgotten: a restart counts as one more try."""
        self.pe = Pe(self.folder)
        record = self.pe.on_disk()
        self.version = 0 if record.code is None else record.code.version
        self.before = 0 if record.before is None else record.slots[record.before].version
        self.on_trial, self.passed = record.tries is not None, False
        self.failed.discard(self.version)

    @invariant()
    def what_runs_is_what_the_model_says(self) -> None:
        loader = self.pe.loader
        assert self.pe.version == loader.program.version == self.version
        assert self.version not in self.failed
        assert (loader.path is None) is (self.version == 0)
        if loader.path is not None:
            assert Path(loader.path).read_bytes() == bundle(self.version).content
        assert self.pe.images == loader.images == ({IMAGE} if self.version else set())

    def teardown(self) -> None:
        """When the disk answers, its record becomes what the loader says."""
        with suppress(AttributeError):
            for _ in range(40):
                if self.pe.keeper.work is not None:
                    self.answered("fine")
                self.wait(RETRY_NS)
            self.what_runs_is_what_the_model_says()
            record = self.pe.on_disk()
            assert (0 if record.code is None else record.code.version) == self.version
            assert (record.tries is None) is (not self.on_trial)
            assert not (self.on_trial and self.passed)


def test_any_order_of_orders_answers_and_failures(tmp_path: Path) -> None:
    Anything.root = tmp_path
    run_state_machine_as_test(
        Anything,
        settings=settings(
            max_examples=part_of(200), stateful_step_count=40, deadline=None, suppress_health_check=list(HealthCheck)
        ),
    )
