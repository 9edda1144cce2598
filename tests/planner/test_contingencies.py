"""Plans made ahead: numbered, kept, read back, looked up, and distributed to the PEs."""

import random
import zlib
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration, Running
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.situation import Situation, elements, places
from heronry_dg.verify import verify
from heronry_manager.contingency.configuration_code import ConfigurationCode, objective_of, worth_of
from heronry_manager.contingency.contingencies import Contingencies, contingencies
from heronry_manager.contingency.file_format import (
    ContingencyFileError,
    from_bytes,
    read_contingencies,
    to_bytes,
)
from heronry_manager.contingency.journal import Journal, JournalError
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.core.tables.contingency_numbers import ContingencyNumbers, loaded, on_board
from heronry_manager.planner.exact import plan
from heronry_manager.planner.safe_mode import safe_mode
from heronry_manager.planner.sweep import Outcome, Scope, Sweep
from heronry_wire.contingency_block import Preloaded, write_block
from heronry_wire.packing import PackingError, Unpacker, pack
from planner.random_specs import random_spec
from planner.test_sweep import CHUTE, Asked, scope_of


def made_for(spec: Spec, scope: Scope) -> Contingencies:
    swept = Sweep(spec, scope)
    swept.run(Asked(spec))
    safe = {phase: safe_mode(spec, phase, swept.running(phase) or {}) for phase in scope.phases}
    return contingencies(spec, scope, swept.outcomes, safe)


MADE = made_for(CHUTE, scope_of(CHUTE, 2))
RUNNING = placement(plan(CHUTE, Situation()).configuration)
GPS = frozenset({"device:gps"})


# The value and its file


def test_configurations_are_numbered_as_they_are_wanted_on_board() -> None:
    assert MADE.configuration(1) == plan(CHUTE, Situation()).configuration
    assert MADE.phases[0].safe_mode <= 2
    first_use: dict[int, int] = {}
    for _, down, made in MADE.entries():
        first_use.setdefault(made.number, len(down))
    first_use.setdefault(MADE.phases[0].safe_mode, 0)
    assert [first_use[number] for number in range(1, len(MADE.configurations) + 1)] == sorted(first_use.values())
    assert len(set(map(repr, MADE.configurations))) == len(MADE.configurations), "each is kept once"


def test_a_file_is_read_back_whole_and_equal_ones_are_equal_bytes() -> None:
    data = to_bytes(MADE, CHUTE)
    assert from_bytes(data, CHUTE) == MADE
    assert to_bytes(made_for(CHUTE, scope_of(CHUTE, 2)), CHUTE) == data


@given(st.randoms(use_true_random=False))
def test_any_spec_with_phases_is_read_back(rng: random.Random) -> None:
    spec = random_spec(rng, modules=4)
    made = made_for(spec, Scope(elements(spec)[:3], 1, tuple(spec.phases) or (None,)))
    assert from_bytes(to_bytes(made, spec), spec) == made


@given(st.integers(0, 10**9), st.integers(1, 255))
def test_any_damage_is_found(where: int, flip: int) -> None:
    data = bytearray(to_bytes(MADE, CHUTE))
    data[where % len(data)] ^= flip
    with pytest.raises(ContingencyFileError):
        from_bytes(bytes(data), CHUTE)


def sealed(content: bytes) -> bytes:
    return content + sha256(content).digest()


def forged(body: bytes, length: int | None = None) -> bytes:
    head = b"HERONRY\x02" + bytes.fromhex(CHUTE.digest) + (len(body) if length is None else length).to_bytes(4, "big")
    return sealed(head + zlib.compress(body))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "not a contingency file"),
        (b"x" * 200, "not a contingency file"),
        (sealed(b"HERONRY\x09" + bytes(60)), "format 9"),
        (sealed(b"HERONRY\x02" + bytes(60)), "another spec, or another version of spec elevator_and_chute"),
        (forged(b"", 1 << 30), "more than any contingency file has"),
        (forged(b""), "cannot be read"),
        (forged(pack([1, 0, 1, 99])), "cannot be read"),
        (forged(pack([0, 0, 0, 1, 0, 1, 2, 99, 99])), "cannot be read"),
        (forged(pack([0, 0, 0, 1, 0, 1, 13, *[0] * 13, 2])), "names configuration 2, which is not one of the 1 in"),
        (
            forged(pack([0, 0, 0, 1, 0, 1, 13, *[0] * 13, 1, 1, 1, 1, *[0] * 10, 2, 0, 0])),
            "exactly one plan for each fault set",
        ),
        (
            forged(pack([0, 0, 0, 1, 0, 1, 13, *[0] * 13, 1, 1, 1, 1, *[0] * 10, 1, 1])),
            "exactly one plan for each fault set",
        ),
        (
            forged(pack([0, 0, 0, 1, 0, 1, 13, *[0] * 13, 1, 1, 1, 1, *[0] * 10, 1, 0, 0, 7])),
            "bytes follow the last phase",
        ),
        (forged(pack([0, 0, 0, 1, 0, 1, 13, *[0] * 13, 1, 1, 1, 1, *[0] * 10, 1, 0, 3, 0, 0, 1])), "have this plan"),
        (forged(pack([0, 0, 0, 1, 0, 1, 13, *[0] * 13, 1, 1, 1, 1, *[0] * 10, 1, 0, 2, 0, 0])), "cannot be read"),
    ],
)
def test_what_is_no_file_of_this_spec_is_one_sentence(data: bytes, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "some.contingencies"
    file.write_bytes(data)
    with pytest.raises(ContingencyFileError, match=sentence) as caught:
        read_contingencies(file, CHUTE)
    assert str(caught.value).endswith("make it anew with 'heronry contingencies'")


def test_a_row_that_means_nothing_is_refused() -> None:
    code = ConfigurationCode(CHUTE)
    good = code.encode(MADE.configuration(1))
    assert code.decode(good) == MADE.configuration(1)
    low_quality_altitude_alone = pack([0, 0, 0, 1, 2, *[0] * 9])  # it reads from what does not run
    for bad in (good[:-1], good + b"\0", pack([200]), b"\xff" * 11, low_quality_altitude_alone):
        with pytest.raises(PackingError):
            code.decode(bad)
    with pytest.raises(PackingError, match="instead of 10"):
        objective_of([1, 2, 3])
    outcome = plan(CHUTE, Situation(GPS), RUNNING).objective
    assert objective_of(worth_of(outcome)) == outcome


@given(st.lists(st.integers(0, 2**69)))
def test_numbers_come_back(numbers: list[int]) -> None:
    unpacker = Unpacker(pack([len(numbers), *numbers]))
    assert unpacker.numbers() == numbers
    assert unpacker.left() == 0


def test_a_text_that_ends_too_early_is_found() -> None:
    with pytest.raises(PackingError, match="an entry is cut off"):
        Unpacker(pack([3, 1])).text()


# Look-up


def test_what_was_made_ahead_is_found_when_its_precondition_holds() -> None:
    table = ContingencyTable(CHUTE, MADE)
    found = table.plan(GPS, None, RUNNING)
    assert found is not None
    assert found.configuration == plan(CHUTE, Situation(GPS), RUNNING).configuration
    assert found.now.down == GPS
    assert found.objective == plan(CHUTE, Situation(GPS), RUNNING).objective
    assert table.plan(GPS, None, RUNNING) is found, "made once"


def test_a_set_that_comes_to_the_same_is_found() -> None:
    table = ContingencyTable(CHUTE, MADE)
    tail = frozenset({"pe:tail_pe"})
    everything = tail | {"device:elevator_servo_1", "device:elevator_servo_2", "module:angle_driver"}
    assert table.find(everything, None, RUNNING) == table.find(tail, None, RUNNING)
    assert table.find(everything | {"bus:can0"}, None, RUNNING) == table.find(frozenset({"bus:can0"}), None, RUNNING)


@given(st.sets(st.sampled_from(elements(CHUTE)), max_size=4))
def test_whatever_is_found_is_the_best(down: set[str]) -> None:
    table = ContingencyTable(CHUTE, MADE)
    found = table.find(frozenset(down), None, RUNNING)
    if found is not None:
        assert found.objective == plan(CHUTE, Situation(frozenset(down)), RUNNING).objective
    else:
        assert len(down) > 2


def test_anything_else_is_for_the_planner() -> None:
    table = ContingencyTable(CHUTE, MADE)
    elsewhere = {**RUNNING, "state_estimator": ("only", "nowhere")}
    assert table.plan(GPS, None, elsewhere) is None, "something else runs"
    assert table.find(GPS, None, None) is None, "what runs is not known"
    assert table.find(GPS, "glide", RUNNING) is None, "another phase"
    assert table.find(frozenset({"device:gps", "device:barometer", "pe:control_pe"}), None, RUNNING) is None, "too many"


def test_at_the_start_changes_are_free() -> None:
    found = ContingencyTable(CHUTE, MADE).plan(frozenset(), None, None)
    assert found is not None
    assert found.configuration == plan(CHUTE, Situation()).configuration


# On board


def test_every_pe_holds_what_its_table_has_room_for() -> None:
    tight = {
        name: replace(pe, table_bytes=room) for (name, pe), room in zip(CHUTE.pes.items(), (9999, 40, 1), strict=True)
    }
    spec = replace(CHUTE, pes=tight)
    sensor, control, tail = on_board(spec, MADE)
    assert sensor.held == len(MADE.configurations)
    assert 0 < control.held < len(MADE.configurations)
    assert len(control.block) <= 40
    assert (tail.held, tail.block) == (0, b"")
    compiled = [Compiler(spec).configuration(one) for one in MADE.configurations[: control.held + 1]]
    node = CHUTE.pes["control_pe"].node_id
    assert len(write_block([Preloaded(one.slices[node], one.digest) for one in compiled])) > 40


def test_the_manager_knows_the_number_of_a_configuration_and_the_pes_that_hold_it() -> None:
    held = on_board(CHUTE, MADE)
    numbers = ContingencyNumbers(CHUTE, MADE, [replace(held[0], held=2), *held[1:]])
    assert [numbers.number(one) for one in MADE.configurations] == list(range(1, len(MADE.configurations) + 1))
    assert numbers.number(Configuration({"state_estimator": MADE.configuration(1).modules["state_estimator"]})) == 0
    assert [numbers.holds(held[0].pe, number) for number in range(4)] == [False, True, True, False]
    assert [numbers.configuration(number) for number in (0, 1, 4095)] == [None, MADE.configuration(1), None]
    first, *others = (one.held for one in held)
    told = {"plans": len(MADE.configurations), "on_board": dict(zip(CHUTE.pes, [2, *others], strict=True))}
    assert first > 2
    assert numbers.status() == told


def test_a_loaded_table_holds_the_slices_with_the_digests_of_their_configurations() -> None:
    for one in on_board(CHUTE, MADE):
        table = loaded(Compiler(CHUTE).table(one.pe), one)
        compiled = [Compiler(CHUTE).configuration(each) for each in MADE.configurations[: one.held]]
        assert table.preloaded() == tuple(Preloaded(each.slices[table.node_id], each.digest) for each in compiled)


# The journal


OUTCOME = Outcome(MADE.configuration(1), plan(CHUTE, Situation()).objective, optimal=True)
WORSE = Outcome(Configuration(), plan(CHUTE, Situation(frozenset({"bus:can0"}))).objective, optimal=False)
SCOPE = scope_of(CHUTE, 2)


def journal_with(file: Path, *downs: frozenset[str]) -> None:
    with Journal(file, CHUTE, SCOPE) as journal:
        for down in downs:
            journal.add(None, down, OUTCOME)


def test_a_journal_is_taken_up(tmp_path: Path) -> None:
    file = tmp_path / "j"
    journal_with(file, frozenset(), GPS)
    with Journal(file, CHUTE, SCOPE) as journal:
        assert journal.known == {(None, frozenset()): OUTCOME, (None, GPS): OUTCOME}
        journal.add("glide", frozenset({"bus:can0"}), WORSE)
    with Journal(file, CHUTE, SCOPE) as journal:
        assert journal.known["glide", frozenset({"bus:can0"})] == WORSE
        journal.remove()
    assert not file.exists()


@given(st.integers(0, 10_000), st.binary(max_size=8))
def test_wherever_it_was_torn_it_goes_on_from_the_last_whole_answer(
    tmp_path_factory: pytest.TempPathFactory, cut: int, rest: bytes
) -> None:
    file = tmp_path_factory.mktemp("journal") / "j"
    journal_with(file, frozenset(), GPS)
    data = file.read_bytes()
    kept = data[: cut % (len(data) + 1)]
    file.write_bytes(kept + rest)
    whole = max(0, kept.count(b"\n") - 1)
    with Journal(file, CHUTE, SCOPE) as journal:
        assert len(journal.known) in (whole, whole + (kept + rest == data))
        journal.add(None, frozenset({"pe:tail_pe"}), OUTCOME)
        count = len(journal.known)
    with Journal(file, CHUTE, SCOPE) as journal:
        assert len(journal.known) == count + 1, "what was added after the tear is there"


def test_a_journal_of_something_else_is_begun_anew(tmp_path: Path) -> None:
    file = tmp_path / "j"
    journal_with(file, GPS)
    with Journal(file, CHUTE, replace(SCOPE, faults=1)) as journal:
        assert journal.known == {}
    with Journal(file, CHUTE, SCOPE) as journal:
        assert journal.known == {}


@pytest.mark.parametrize("line", ['[null,["pe:x"],"zz",[0],true]', '[null,[],"01",[0,0,0,0,0,0,0,0,0,0],true]', "7"])
def test_a_line_that_says_nothing_ends_what_is_known(line: str, tmp_path: Path) -> None:
    file = tmp_path / "j"
    journal_with(file, GPS)
    text = line.encode()
    with file.open("ab") as stream:
        stream.write(b"%08x %s\n" % (zlib.crc32(text), text))
    with Journal(file, CHUTE, SCOPE) as journal:
        assert list(journal.known) == [(None, GPS)]


def test_two_runs_do_not_write_one_journal(tmp_path: Path) -> None:
    with Journal(tmp_path / "j", CHUTE, SCOPE), pytest.raises(JournalError, match="another run"):
        Journal(tmp_path / "j", CHUTE, SCOPE)


# Places in use


IN_USE = made_for(CHUTE, replace(scope_of(CHUTE, 1), places=True))


def test_the_places_in_use_are_planned_for_and_numbered_last() -> None:
    plain = made_for(CHUTE, scope_of(CHUTE, 1))
    assert IN_USE.configurations[: len(plain.configurations)] == plain.configurations
    used = {f"module:{name}@{pe}" for name, (_, pe) in RUNNING.items() if len(places(CHUTE, name)) > 1}
    assert {place for _, down, _ in IN_USE.entries() for place in down if "@" in place} == used
    for _, down, made in IN_USE.entries():
        now = Situation(down)
        assert verify(CHUTE, now, IN_USE.configuration(made.number)) == []
        assert made.objective == plan(CHUTE, now, RUNNING).objective
    assert from_bytes(to_bytes(IN_USE, CHUTE), CHUTE) == IN_USE


def test_a_place_is_looked_up_and_implied_by_its_pe_and_its_module() -> None:
    table = ContingencyTable(CHUTE, IN_USE)
    place = next(place for place, _ in IN_USE.phases[0].by_place)
    module, _, pe = place.removeprefix("module:").partition("@")
    alone = table.plan(frozenset({place}), None, RUNNING)
    assert alone is not None
    assert alone.configuration.modules.get(module, Running("elsewhere", "only")).pe != pe
    for element in (f"pe:{pe}", f"module:{module}"):
        assert table.find(frozenset({element, place}), None, RUNNING) == table.find(frozenset({element}), None, RUNNING)
    others = frozenset(places(CHUTE, module))
    assert table.find(others, None, RUNNING) is None, "two places are no single fault"
