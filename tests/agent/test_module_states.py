"""What `save` and `restore` of modules may do: they cost the module its state, and nothing else."""

import math
import re
import signal
import struct
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.modules_with_states import Counts, Gives
from heronry_agent.core.vocabulary import (
    Failure,
    KeptState,
    StateEvent,
    StateLacking,
    StateRestored,
    StateSaved,
    StateUnused,
)
from heronry_agent.module import Datum, Module
from heronry_agent.shell.code_digest import code_digest
from heronry_agent.shell.module_runner import ModuleRunner, Orders, Result
from heronry_agent.shell.partition import Partition
from heronry_agent.shell.partition_messages import Save, Start, Step, Stop, decode_answer, encode_orders
from heronry_agent.shell.partition_states import decode_state, encode_state, kept_of, state_of
from heronry_agent.shell.time_limit import MOST_S, TookTooLong, time_limit
from heronry_wire.bundle import pack
from heronry_wire.checkpoint_frames import Lack, SentState
from heronry_wire.sansio import NEVER_NS

IMAGES = "agent.modules_with_states"
M = 7
S = 1_000_000_000


def orders(image: str, mode: str = "only") -> Orders:
    return Orders("m", f"{IMAGES}:{image}", mode, 50_000_000, None)


def runner(image: str, *, steps: int = 0) -> ModuleRunner:
    """A runner in which the module runs, after some steps."""
    one = ModuleRunner(lambda: 0, time_limit)
    assert one.start(M, orders(image), 0) is None
    for _ in range(steps):
        one.step(M, 0, NEVER_NS, None, {})
    return one


def kept(data: bytes, code: type = Counts, since_ns: int = 5 * S, number: int = 3) -> KeptState:
    return KeptState(SentState.of(number, 9, data, code_digest(code)), since_ns, since_ns + S)


STATE = struct.pack("<2d", 41.0, 0.5)


def test_a_state_is_saved_as_doubles_with_the_digest_of_the_code() -> None:
    saved = runner("Counts", steps=41).save(M, 9, 16)
    assert saved == StateSaved(M, 9, code_digest(Counts), STATE, 0)


def test_a_module_that_does_not_run_is_not_saved() -> None:
    assert ModuleRunner(lambda: 0).save(M, 0, 16) is None


@pytest.mark.parametrize(
    ("image", "lack", "reason"),
    [
        ("Raises", Lack.RAISES, "ValueError: no state today (modules_with_states.py:"),
        ("Hangs", Lack.HANGS, "save takes too long"),
        ("Bare", Lack.RAISES, "the module has a checkpoint in the spec, but no method `save`"),
    ],
)
def test_a_state_that_cannot_be_saved_leaves_the_module_running(image: str, lack: Lack, reason: str) -> None:
    one = runner(image)
    saved = one.save(M, 9, 16)
    assert isinstance(saved, StateLacking)
    assert (saved.lack, reason in saved.reason) == (lack, True)
    assert isinstance(one.step(M, 0, NEVER_NS, None, {}), Result)


@pytest.mark.parametrize(
    "given",
    [None, 1.0, "state", b"state", {1.0: 2.0}, (math.nan,), (math.inf,), (1.0, None), ("1",), (1 << 2000,), (1j,)],
)
def test_what_is_no_tuple_of_finite_numbers_is_no_state(given: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Gives, "given", given)
    saved = runner("Gives").save(M, 9, 16)
    assert isinstance(saved, StateLacking)
    assert saved.lack is Lack.NO_NUMBERS


class Shy:
    def __repr__(self) -> str:
        raise RuntimeError("not me")


class Sly(float):
    def __float__(self) -> float:
        raise RuntimeError("not me")


@pytest.mark.parametrize("given", [Shy(), (Shy(),), (Sly(1.0),)])
def test_what_cannot_be_shown_or_converted_is_no_state_either(given: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Gives, "given", given)
    saved = runner("Gives").save(M, 9, 16)
    assert isinstance(saved, StateLacking)
    assert (saved.lack, "RuntimeError: not me" in saved.reason) == (Lack.RAISES, True)


@pytest.mark.parametrize(
    ("given", "data"), [((), b""), ((True, 2), struct.pack("<2d", 1.0, 2.0)), ([1], bytes(6) + b"\xf0\x3f")]
)
def test_whole_numbers_lists_and_nothing_are_states(
    given: object, data: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Gives, "given", given)
    saved = runner("Gives").save(M, 9, 16)
    assert isinstance(saved, StateSaved)
    assert saved.data == data


def test_a_state_that_is_too_long_says_by_how_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Gives, "given", (1.0, 2.0, 3.0))
    saved = runner("Gives").save(M, 9, 16)
    assert saved == StateLacking(M, Lack.TOO_LONG, "save gives 3 numbers, 24 bytes; the spec has bytes: 16")


def started(image: str, state: KeptState | Lack, now_ns: int = 5 * S) -> tuple[ModuleRunner, object]:
    one = ModuleRunner(lambda: 0, time_limit)
    return one, one.start(M, orders(image), now_ns, state)


def test_a_module_goes_on_from_its_state() -> None:
    one, outcome = started("Counts", kept(STATE), 5 * S + 123)
    assert outcome == StateRestored(M, 123)
    code = one.code(M)
    assert isinstance(code, Counts)
    assert (code.count, code.age_ns) == (41, 123)


@pytest.mark.parametrize(
    ("state", "now_ns", "lack"),
    [
        (Lack.NO_STATE, 5 * S, Lack.NO_STATE),
        (kept(STATE), 6 * S + 1, Lack.TOO_OLD),
        (kept(STATE, Gives), 5 * S, Lack.OTHER_CODE),
        (kept(STATE[:-1]), 5 * S, Lack.OTHER_CODE),
        (KeptState(SentState(3, 9, STATE, 0), 5 * S, 6 * S), 5 * S, Lack.OTHER_CODE),
    ],
)
def test_a_module_starts_without_a_state_that_it_must_not_use(state: KeptState | Lack, now_ns: int, lack: Lack) -> None:
    one, outcome = started("Counts", state, now_ns)
    assert outcome == StateLacking(M, lack)
    code = one.code(M)
    assert isinstance(code, Counts)
    assert code.count == 0


@pytest.mark.parametrize("image", ["Raises", "Hangs"])
def test_a_restore_that_fails_leaves_a_new_object_without_a_state(image: str) -> None:
    code = getattr(sys.modules[IMAGES], image)
    one, outcome = started(image, kept(STATE, code))
    assert isinstance(outcome, StateLacking)
    assert outcome.lack is Lack.REFUSED
    left = one.code(M)
    assert isinstance(left, Counts)
    assert (left.count, left.age_ns) == (0, None)


def test_a_module_that_goes_on_in_another_mode_needs_no_state() -> None:
    one = runner("Keeps", steps=3)
    one.stop(M, keep=True)
    assert one.start(M, orders("Keeps", "other"), 5 * S, kept(STATE)) == StateUnused(M)
    code = one.code(M)
    assert isinstance(code, Counts)
    assert code.count == 3


def test_an_image_that_cannot_be_built_is_a_failure_with_a_state_too() -> None:
    _, outcome = started("Nothing", kept(STATE))
    assert isinstance(outcome, Failure)


# The digest of the code


def written(folder: Path, name: str, **files: str) -> type[Module]:
    """Write a package, import it anew, and give its class `main:Main`."""
    for module in [one for one in sys.modules if one == name or one.startswith(f"{name}.")]:
        del sys.modules[module]
    (folder / name).mkdir(exist_ok=True)
    for file, text in {"__init__": "", **files}.items():
        (folder / name / f"{file}.py").write_text(text)
    main = __import__(f"{name}.main", fromlist=["Main"])
    found: type[Module] = main.Main
    return found


MAIN = """
from heronry_agent.module import Datum, Module
from heronry_agent.parts.states import LowPass
import {name}.helper
import math
import re
class Main({base}):
    pass
"""


def test_the_digest_is_that_of_the_files_of_the_package_that_the_class_uses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    main = MAIN.format(name="state_version", base="Module")

    def digest(**files: str) -> bytes:
        return code_digest(written(tmp_path, "state_version", **{"main": main, "helper": "A = 1", **files}))

    first = digest()
    assert len(first) == 8
    assert digest(unused="B = 1") == first
    assert digest(helper="A = 2") != first
    assert digest(main=main + "\nC = 1\n") != first
    assert digest() == first
    assert digest(main=MAIN.format(name="state_version", base="LowPass")) != first


@pytest.mark.parametrize(
    "statement",
    [
        "from constants_of_a_state.gains import UNIT",
        "from .gains import UNIT",
        "from . import gains",
        "from constants_of_a_state.deep.leaf import ONE",
        "from constants_of_a_state.between import UNIT",
        "from .deep.below import UNIT",
        "def later():\n    import constants_of_a_state.gains",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .deep import *",
    ],
)
def test_the_digest_covers_files_of_which_only_constants_are_imported(
    statement: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    package = tmp_path / "constants_of_a_state"
    (package / "deep").mkdir(parents=True)
    (package / "deep" / "__init__.py").write_text("from ..gains import UNIT\n")
    (package / "deep" / "leaf.py").write_text("ONE = 1\n")
    (package / "deep" / "below.py").write_text("from ..gains import UNIT\n")
    main = f"from heronry_agent.module import Module\n{statement}\nclass Main(Module):\n    pass\n"

    def digest(gains: str) -> bytes:
        files = {"main": main, "between": "from .gains import UNIT", "gains": gains}
        return code_digest(written(tmp_path, "constants_of_a_state", **files))

    assert digest("UNIT = 1") == digest("UNIT = 1") != digest("UNIT = 2")


def test_a_compiled_module_counts_by_the_source_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    code = written(tmp_path, "compiled_state", main="class Main:\n    pass\n")
    in_python = code_digest(code)
    compiled = tmp_path / "compiled_state" / "main.cpython-311-x86_64-linux-gnu.so"
    compiled.write_bytes(b"machine code")
    monkeypatch.setattr(sys.modules[code.__module__], "__file__", str(compiled))
    monkeypatch.setattr("heronry_agent.shell.code_digest._DIGESTS", {})
    assert code_digest(code) == in_python


def test_a_class_without_a_file_has_a_digest() -> None:
    code = type("Made", (Module,), {"__module__": "made_up"})
    assert len(code_digest(code)) == 8
    sys.modules["made_up"] = ModuleType("made_up")
    try:
        assert code_digest(type("Made", (Module,), {"__module__": "made_up"})) == code_digest(code)
    finally:
        del sys.modules["made_up"]


def zipped(folder: Path, name: str) -> Path:
    """A bundle with a module that has a checkpoint; partitions import from its file as it is."""
    code = (
        "from heronry_agent.module import Module\nclass Main(Module):\n    def save(self):\n        return (1.0,)\n"
        "    def restore(self, state, age_ns):\n        pass\n"
    )
    file = folder / f"{name}.bundle"
    file.write_bytes(pack("states", 1, (f"{name}:Main",), {f"{name}.py": code.encode()}).content)
    return file


def test_a_module_of_a_bundle_is_saved_and_restored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(zipped(tmp_path, "states_of_a_bundle"))
    one, image = ModuleRunner(lambda: 0, time_limit), Orders("m", "states_of_a_bundle:Main", "only", 50_000_000, None)
    assert one.start(M, image, 0) is None
    saved = one.save(M, 9, 8)
    assert isinstance(saved, StateSaved)
    state = KeptState(SentState.of(3, 9, saved.data, saved.code), 0, NEVER_NS)
    assert one.start(M, image, 0, state) == StateRestored(M, 0)


def test_code_whose_file_is_gone_has_no_state_and_runs_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = zipped(tmp_path, "states_of_a_lost_bundle")
    monkeypatch.syspath_prepend(file)
    one, image = (
        ModuleRunner(lambda: 0, time_limit),
        Orders("m", "states_of_a_lost_bundle:Main", "only", 50_000_000, None),
    )
    assert one.start(M, image, 0) is None
    file.unlink()
    saved = one.save(M, 9, 8)
    assert isinstance(saved, StateLacking)
    assert (saved.lack, "the files of its code cannot be read" in saved.reason) == (Lack.RAISES, True)
    again = one.start(M, image, 5 * S, kept(STATE))
    assert isinstance(again, StateLacking)
    assert again.lack is Lack.OTHER_CODE


# Between agent and partition

states = st.builds(
    KeptState,
    st.builds(SentState, st.integers(0, 255), st.integers(0, 255), st.binary(max_size=40), st.integers(0, 2**24 - 1)),
    st.integers(0, 2**62),
    st.integers(0, 2**62),
)
answers = st.one_of(
    st.builds(
        StateSaved,
        st.integers(0, 0xFFFF),
        st.integers(0, 255),
        st.binary(min_size=8, max_size=8),
        st.binary(),
        st.integers(0, 2**62),
    ),
    st.builds(StateRestored, st.integers(0, 0xFFFF), st.integers(0, 2**62)),
    st.builds(StateLacking, st.integers(0, 0xFFFF), st.sampled_from(Lack), st.text(max_size=100)),
    st.builds(StateUnused, st.integers(0, 0xFFFF)),
)


@given(st.one_of(st.none(), st.sampled_from(Lack), states))
def test_a_state_for_a_start_arrives_unchanged(state: KeptState | Lack | None) -> None:
    assert state_of(kept_of(state)) == state


@given(answers)
def test_an_answer_about_a_state_arrives_unchanged(answer: StateEvent) -> None:
    assert decode_state(encode_state(answer)) == answer == decode_answer(encode_state(answer))


def test_a_partition_saves_and_restores() -> None:
    partition = Partition(ModuleRunner(lambda: 0, time_limit))

    def answers_to(*given: Start | Stop | Step | Save) -> list[object]:
        return [decode_answer(packet) for packet in partition.accept(encode_orders(given))]

    start = Start(M, orders("Counts"), ())
    assert answers_to(start, Save(M + 1, 0, 16)) == []
    _, saved = answers_to(Step(M, 1, 0, NEVER_NS, None, ()), Save(M, 9, 16))
    assert isinstance(saved, StateSaved)
    state = KeptState(SentState.of(3, 9, saved.data, saved.code), 0, NEVER_NS)
    (restored,) = answers_to(Stop(M, keep=False), start._replace(kept=kept_of(state)))
    assert isinstance(restored, StateRestored)


# The page


def test_the_class_of_the_page_goes_on_where_it_was() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "checkpoints.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    trim = sys.modules["page_trim"] = ModuleType("page_trim")
    try:
        exec(code, vars(trim))
        one = ModuleRunner(lambda: 0)
        image = Orders("m", "page_trim:Trim", "only", 50_000_000, None)
        assert one.start(M, image, 0) is None
        for _ in range(20):
            result = one.step(M, 0, NEVER_NS, None, {"": ("pitch_angle", Datum(5.0, 1, 0))})
        assert isinstance(result, Result)
        saved = one.save(M, 9, 8)
        assert isinstance(saved, StateSaved)
        state = KeptState(SentState.of(3, 9, saved.data, saved.code), 0, NEVER_NS)
        assert one.start(M, image, 0, state) == StateRestored(M, 0)
        assert one.step(M, 0, NEVER_NS, None, {}) == result
    finally:
        del sys.modules["page_trim"]


# The limit of time


def test_waiting_for_a_processor_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    before, rings = signal.setitimer, []

    def counted(which: int, seconds: float, interval: float = 0.0) -> tuple[float, float]:
        rings.append(seconds)
        return before(which, seconds, interval)

    monkeypatch.setattr(signal, "setitimer", counted)
    spent = iter([0.0, MOST_S / 2, MOST_S])  # at the beginning, and at two alarms
    monkeypatch.setattr("heronry_agent.shell.time_limit._spent_s", lambda: next(spent))
    with pytest.raises(TookTooLong), time_limit():
        time.sleep(60)
    assert rings == [MOST_S, MOST_S / 2, 0, 0.0]


def test_a_timer_that_ran_before_runs_on() -> None:
    assert signal.setitimer(signal.ITIMER_REAL, 60) == (0.0, 0.0)
    try:
        with time_limit():
            pass
        assert 0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 60
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
