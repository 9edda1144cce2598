"""The slices of a configuration on the wire, read back with the indices of tables alone, as the PEs do it."""

import itertools
import random
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_dg.situation import Situation, hosts_when_all_is_up, situation, survivors
from heronry_dg.traffic import hops, identifiers
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.core.topology import command_period_ns
from heronry_manager.planner.exact import plan
from heronry_wire.configuration_slice import Slice, decode_slice
from heronry_wire.management import SLICE_BYTES_PER_FRAME
from heronry_wire.pe_table import PeTable
from manager.one_manager import SPEC_TEXT, two_tails
from planner.comparison import crossing_case
from planner.enumerator import Enumerator
from planner.random_specs import Case, random_case
from thoroughness import part_of

SEEDS = range(part_of(600, 2))
SEEN, MOST = 300, 6  # configurations of one random spec: found at most, and taken from these
MUST_APPEAR = ("wires", "remote", "forwarded", "published on two ports", "nothing to do")
SITUATIONS = [
    ("elevator_and_chute", None, ()),
    ("elevator_and_chute", None, ("device:gps", "device:elevator_servo_1")),
    ("elevator_and_chute", None, ("pe:tail_pe",)),
    ("big_blue", "ascent", ()),
    ("big_blue", "glide", ()),
    ("big_blue", "landing", ("pe:flight",)),
    ("big_blue", "glide", ("bus:radio",)),
]


@cache
def shipped(name: str) -> Spec:
    return load(shipped_spec_path(name))


@cache
def shipped_configurations() -> tuple[tuple[Spec, Configuration], ...]:
    found = []
    for name, phase, down in SITUATIONS:
        spec = shipped(name)
        found.append((spec, plan(spec, situation(spec, down=down, phase=phase), None).configuration))
    return tuple(found)


def random_cases() -> Iterator[Case]:
    for seed in SEEDS:
        draw = crossing_case if seed % 2 else random_case
        case = draw(random.Random(seed), modules=5)
        yield replace(case, now=replace(case.now, priorities={}))  # so that more modules are wanted


@cache
def random_configurations() -> tuple[tuple[Spec, tuple[Configuration, ...]], ...]:
    """Legal configurations of random specs, as brute force finds them."""
    found = []
    for case in random_cases():
        rng = random.Random(0)
        legal = [one for one, _, _ in itertools.islice(Enumerator(case.spec, case.now).every(most=SEEN), SEEN)]
        drawn = rng.sample(legal, min(MOST, len(legal))) + [scattered(rng, case.spec) for _ in range(2)]
        found.append((case.spec, tuple(one for i, one in enumerate(drawn) if one not in drawn[:i])))
    return tuple(found)


def scattered(rng: random.Random, spec: Spec) -> Configuration:
    """Modules all over the place, wired at random: not legal, but as good as any to be compiled."""
    left = survivors(spec, Situation())
    hosts = {m.name: left.hosts(m) for m in spec.modules.values()}
    placed = {
        name: Running(rng.choice(on), rng.choice(list(spec.modules[name].modes))) for name, on in hosts.items() if on
    }
    return Configuration({name: replace(r, inputs=dict(_wires(rng, spec, placed, name))) for name, r in placed.items()})


def _wires(rng: random.Random, spec: Spec, placed: Mapping[str, Running], consumer: str) -> Iterator[tuple[str, Wire]]:
    route = survivors(spec, Situation()).route
    for path, leaf in Configuration(placed).mode(spec, consumer).leaves():
        offers = [
            Wire(name, leaf.variable, spec.modules[name].modes[running.mode].gives[leaf.variable])
            for name, running in placed.items()
            if leaf.variable in spec.modules[name].modes[running.mode].gives
            and route(running.pe, placed[consumer].pe) is not None
        ]
        if offers and rng.random() < 0.8:
            yield path, rng.choice(offers)


def everything() -> Iterator[tuple[Spec, Configuration]]:
    yield from shipped_configurations()
    for spec, configurations in random_configurations():
        yield from ((spec, configuration) for configuration in configurations)


def decoded(spec: Spec, configuration: Configuration) -> dict[str, tuple[PeTable, Slice]]:
    """Table and slice of every PE, the slice from its bytes."""
    compiler = Compiler(spec)
    bodies = compiler.configuration(configuration).slices
    tables = {pe: compiler.table(pe) for pe in spec.pes}
    return {pe: (table, decode_slice(bodies[table.node_id], table.leaf_counts())) for pe, table in tables.items()}


def test_the_examples_hold_what_they_should() -> None:
    counts: Counter[str] = Counter()
    for spec, configuration in everything():
        counts["configurations"] += 1
        counts["wires"] += any(True for _ in configuration.wires())
        for _, part in decoded(spec, configuration).values():
            counts["remote"] += bool(part.remote)
            counts["forwarded"] += bool(part.forward)
            counts["published on two ports"] += 3 in part.publish.values()
            counts["nothing to do"] += part == Slice()
    assert counts["configurations"] > 150
    rare = {what: counts[what] for what in MUST_APPEAR if counts[what] < 4}
    assert rare == {}


def test_every_module_runs_in_one_slice_and_every_wire_is_in_it() -> None:
    for spec, configuration in everything():
        expected = {
            name: (r.pe, r.mode, {path: (w.producer, w.variable) for path, w in r.inputs.items()})
            for name, r in configuration.modules.items()
        }
        found = [entry for pe, (table, part) in decoded(spec, configuration).items() for entry in runs(pe, table, part)]
        assert len(found) == len(expected)
        assert dict(found) == expected


Run = tuple[str, tuple[str, str, dict[str, tuple[str, str]]]]


def runs(pe: str, table: PeTable, part: Slice) -> Iterator[Run]:
    """What a slice tells its PE: module, and (PE, mode, wires)."""
    entries = {entry.index: entry for entry in table.modules}
    for module in part.modules:
        mode = entries[module.module].modes[module.mode]
        wires = {}
        for leaf, source in zip(mode.leaves, module.sources, strict=True):
            if source is not None:
                assert table.sources[source].variable == leaf.variable
                wires[leaf.path] = (table.sources[source].module, leaf.variable)
        yield entries[module.module].name, (pe, mode.name, wires)


def test_what_is_read_from_afar_names_its_producers_node_and_nothing_else_does() -> None:
    for spec, configuration in everything():
        for pe, (table, part) in decoded(spec, configuration).items():
            read = {source for module in part.modules for source in module.sources if source is not None}
            places = {source: configuration.modules[table.sources[source].module].pe for source in read}
            assert part.remote == {s: spec.pes[place].node_id for s, place in places.items() if place != pe}


def test_slices_carry_each_datum_over_exactly_the_buses_it_is_published_on() -> None:
    for spec, configuration in everything():
        on_buses = carried(decoded(spec, configuration))
        left = survivors(spec, Situation())
        expected: dict[tuple[str, str], Counter[str]] = {}
        for producer, variable, bus in {(h.producer, h.variable, h.bus) for h in hops(left, configuration)}:
            expected.setdefault((producer, variable), Counter())[bus] += 1
        assert on_buses == expected


def carried(parts: Mapping[str, tuple[PeTable, Slice]]) -> dict[tuple[str, str], Counter[str]]:
    """Let every published datum run through the gateways; how often it goes over each bus, by source."""
    going: deque[tuple[int, int, str]] = deque()  # source, node of its producer, bus
    sources = next(iter(parts.values()))[0].sources
    for table, part in parts.values():
        going += [(s, table.node_id, bus) for s, mask in part.publish.items() for bus in buses_of(table, mask)]
    seen: dict[tuple[str, str], Counter[str]] = {}
    while going:
        source, node, bus = going.popleft()
        over = seen.setdefault((sources[source].module, sources[source].variable), Counter())
        over[bus] += 1
        assert over[bus] == 1, "a datum goes in circles, or two PEs send it"
        for table, part in parts.values():
            if bus in [port.bus for port in table.ports] and part.forward.get(source, (0, 0))[0] == node:
                going += [(source, node, to) for to in buses_of(table, part.forward[source][1]) if to != bus]
    return seen


def buses_of(table: PeTable, mask: int) -> list[str]:
    """Buses that a mask names; every bit is one of this PE's ports."""
    assert 0 < mask < 1 << len(table.ports)
    return [port.bus for bit, port in enumerate(table.ports) if mask >> bit & 1]


def test_equal_configurations_have_equal_digests_and_different_ones_different() -> None:
    for spec, configurations in random_configurations():
        compiler = Compiler(spec)
        digests = [compiler.configuration(configuration).digest for configuration in configurations]
        assert len(set(digests)) == len(configurations)
        for configuration, digest in zip(configurations, digests, strict=True):
            backwards = Configuration(dict(reversed(list(configuration.modules.items()))))
            assert compiler.configuration(backwards).digest == digest
        another_file = Compiler(replace(spec, digest="f" * 64))
        assert not set(digests) & {another_file.configuration(c).digest for c in configurations}


def test_a_pe_whose_part_stays_the_same_keeps_its_digest() -> None:
    (spec, before), (_, after) = shipped_configurations()[:2]
    compiler = Compiler(spec)
    old, new = compiler.configuration(before), compiler.configuration(after)
    changed = {node for node in old.slices if old.slices[node] != new.slices[node]}
    assert len(changed) > 0
    assert changed == {node for node in old.slices if old.slice_digests[node] != new.slice_digests[node]}
    assert old.digest != new.digest


def test_a_whole_aircraft_fits_into_few_frames() -> None:
    for spec, configuration in shipped_configurations():
        compiled = Compiler(spec).configuration(configuration)
        assert compiled.slices.keys() == compiled.slice_digests.keys() == {pe.node_id for pe in spec.pes.values()}
        assert max(map(len, compiled.slices.values())) < 30 * SLICE_BYTES_PER_FRAME


STAR = """
dg: 1
buses: {left: {bitrate: 125000}, middle: {bitrate: 125000}, right: {bitrate: 125000}}
pes:
  west:  {node_id: 92, buses: [left], cpu: 1, ram: 1KiB, flash: 1KiB}
  hub:   {node_id: 93, buses: [left, middle, right], cpu: 1, ram: 1KiB, flash: 1KiB}
  north: {node_id: 94, buses: [middle], cpu: 1, ram: 1KiB, flash: 1KiB}
  east:  {node_id: 95, buses: [right], cpu: 1, ram: 1KiB, flash: 1KiB}
variables: {reading: {type: FLOAT}}
modules:
  sensor: {gives: {reading: 1}, runs_on: [west, hub], cpu: 0.1, ram: 1, rate_hz: 10}
  one:    {needs: reading, runs_on: [north], cpu: 0.1, ram: 1, rate_hz: 10}
  other:  {needs: reading, runs_on: [east], cpu: 0.1, ram: 1, rate_hz: 10}
functions: {first: {output: one}, second: {output: other}}
"""


def test_a_gateway_on_three_buses_sends_on_to_both_others() -> None:
    spec = loads(STAR, "star.dg.yaml")
    reads = {"": Wire("sensor", "reading", 1)}
    readers = {"one": Running("north", "only", reads), "other": Running("east", "only", reads)}
    beyond_it = decoded(spec, Configuration({"sensor": Running("west", "only"), **readers}))
    assert beyond_it["west"][1].publish == {0: 0b001}
    assert beyond_it["hub"][1] == Slice(forward={0: (92, 0b110)})
    on_it = decoded(spec, Configuration({"sensor": Running("hub", "only"), **readers}))
    assert on_it["hub"][1].publish == {0: 0b110}
    assert on_it["hub"][1].forward == {}
    assert on_it["east"][1].remote == {0: 93}


# Tables


def all_specs() -> Iterator[Spec]:
    yield from map(shipped, shipped_spec_names())
    yield from (case.spec for case in random_cases())


def beyond(spec: Spec, pe: str, bus: str) -> tuple[set[str], set[str]]:
    """PEs and buses that are reached from a PE over one of its buses, by cutting the PE out."""
    pes, buses = set[str](), {bus}
    while True:
        more = {p.name for p in spec.pes.values() if p.name != pe and buses & set(p.buses)}
        further = {b for name in more for b in spec.pes[name].buses}
        if more <= pes and further <= buses:
            return pes, buses
        pes, buses = pes | more, buses | further


def commanded(spec: Spec) -> set[str]:
    """PEs with a way to the manager's bus."""
    return {
        pe.name for pe in spec.pes.values() if any(spec.manager.bus in beyond(spec, pe.name, b)[1] for b in pe.buses)
    }


def test_a_port_knows_which_pes_are_beyond_it_and_the_uplink_is_the_one_toward_the_manager() -> None:
    gateways_beyond = 0
    for spec in all_specs():
        compiler, reached = Compiler(spec), commanded(spec)
        for pe in spec.pes.values():
            table = compiler.table(pe.name)
            assert [port.bus for port in table.ports] == list(pe.buses)
            if pe.name not in reached:
                continue
            sides = [beyond(spec, pe.name, bus) for bus in pe.buses]
            for port, (pes, _) in zip(table.ports, sides, strict=True):
                assert set(port.nodes) == {spec.pes[name].node_id for name in pes & reached}
            assert [i for i, (_, buses) in enumerate(sides) if spec.manager.bus in buses] == [table.uplink]
            gateways_beyond += len(pe.buses) > 1 and spec.manager.bus not in pe.buses
    assert gateways_beyond > 5


def test_the_ground_of_big_blue_is_beyond_its_gateway() -> None:
    compiler = Compiler(shipped("big_blue"))
    gateway, ground = compiler.table("comms"), compiler.table("ground")
    assert gateway.ports[gateway.uplink].bus == "can0"
    assert {port.bus: port.nodes for port in gateway.ports} == {"can0": tuple(range(92, 99)), "radio": (100,)}
    (radio,) = ground.ports
    assert (radio.bus, radio.wireless, radio.heartbeat_ns, radio.misses) == ("radio", True, 200_000_000, 4)
    assert radio.nodes == tuple(range(92, 100))
    assert ground.uplink == 0


def test_a_table_holds_what_may_run_on_its_pe_and_every_source_of_the_spec() -> None:
    for spec in all_specs():
        compiler, numbers = Compiler(spec), identifiers(spec)
        for pe in spec.pes:
            table = compiler.table(pe)
            assert PeTable.from_json(table.to_json()) == table
            assert (table.spec_digest, table.node_id) == (spec.digest, spec.pes[pe].node_id)
            hosted = [m.name for m in spec.modules.values() if pe in hosts_when_all_is_up(spec, m)]
            assert [module.name for module in table.modules] == hosted
            assert [table.module_names[module.index] for module in table.modules] == hosted
            assert {(s.module, s.variable): s.identifier for s in table.sources} == numbers
            assert [table.sources[i].module for i in range(len(numbers))] == [module for module, _ in spec.sources()]


def test_a_source_has_the_longest_period_of_the_modes_that_give_it() -> None:
    table = Compiler(shipped("big_blue")).table("nav")
    periods = {(s.module, s.variable): s.period_ns for s in table.sources}
    assert periods["telemetry", "telemetry_altitude"] == 250_000_000  # live 40 Hz, slow 4 Hz
    assert periods["air_data", "true_airspeed"] == 50_000_000


def test_what_is_exclusive_or_silent_is_marked() -> None:
    spec = shipped("big_blue")
    marks = {
        module.name: (module.demux, module.movable, module.silent_output)
        for table in map(Compiler(spec).table, spec.pes)
        for module in table.modules
    }
    assert marks["elevator_driver_1"] == (True, False, False)
    assert marks["elevator_control"] == (False, True, False)
    assert marks["guidance"] == (False, True, True)
    assert marks["ground_display"] == (False, False, False), "it drives an actuator"
    assert marks["gps_driver"] == (False, False, False), "it serves no function by itself"
    assert marks["image_archive"] == (False, False, True)


BOTH_SIDES = Path(__file__).parent.parent / "scenarios" / "both_sides.dg.yaml"


def test_what_may_run_on_both_sides_of_a_gateway_is_marked_in_its_table() -> None:
    spec = load(BOTH_SIDES)
    marked = {pe: {s.module for s in Compiler(spec).table(pe).sources if s.movable} for pe in spec.pes}
    assert marked == {"front": set(), "rear": set(), "gateway": {"low_quality_altitude"}, "wing": set()}


def test_commands_come_as_often_as_the_slowest_bus_on_the_way_beats() -> None:
    text = BOTH_SIDES.read_text().replace("can0: {bitrate: 500000}", "can0: {bitrate: 500000, heartbeat_ms: 50}")
    spec = loads(text, "slow.dg.yaml")
    assert {pe: command_period_ns(spec, pe) for pe in spec.pes} == dict.fromkeys(spec.pes, 50_000_000)
    assert Compiler(spec).table("wing").command_period_ns == 50_000_000
    assert command_period_ns(shipped("big_blue"), "ground") == 200_000_000


@pytest.mark.parametrize("name", shipped_spec_names())
def test_tables_and_slices_depend_on_nothing_but_the_file(name: str) -> None:
    one, again = Compiler(shipped(name)), Compiler(load(shipped_spec_path(name)))
    assert [one.table(pe).to_json() for pe in shipped(name).pes] == [
        again.table(pe).to_json() for pe in shipped(name).pes
    ]
    for spec, configuration in itertools.islice(shipped_configurations(), len(SITUATIONS)):
        if spec.name == name:
            assert one.configuration(configuration) == again.configuration(configuration)


def test_the_ends_of_a_demux_are_exclusive_as_its_branches_are() -> None:
    spec = load(Path("dg_specs/examples/demux_paths.dg.yaml"))
    tables = map(Compiler(spec).table, spec.pes)
    exclusive = {module.name for table in tables for module in table.modules if module.demux}
    assert exclusive == {f"{kind}_{n}" for kind in ("elevator_limiter", "limited_servo") for n in (1, 2, 3)}


def test_what_a_spec_says_of_a_driver_is_in_the_table_of_its_pe_completed() -> None:
    text = SPEC_TEXT.replace(
        "kind: actuator, pe: left",
        "kind: actuator, pe: left, driver: pwm, options: {chip: 0}, limits: [-1, 1], safe: 0.5",
    ).replace("kind: actuator, pe: right", "kind: actuator, pe: right, rate_limit: 2")
    compiler = Compiler(loads(text, "two_tails.dg.yaml"))
    (left,) = compiler.table("left").drivers
    assert (left.device, left.driver, left.options) == ("servo_left", "pwm", '{"chip": 0}')
    assert (left.stale_ns, left.least, left.most, left.per_s, left.safe) == (5 * 25_000_000, -1.0, 1.0, None, 0.5)
    (right,) = compiler.table("right").drivers
    assert (right.device, right.driver, right.options) == ("servo_right", None, "{}")
    assert (right.least, right.most, right.per_s, right.safe) == (None, None, 2.0, "release")
    assert compiler.table("middle").drivers == ()
    assert Compiler(two_tails()).table("left").drivers == ()


# Checkpoints


def test_a_pe_is_told_of_the_states_that_it_sends_keeps_and_forwards() -> None:
    text = """
dg: 1
name: kept
buses: {near: {bitrate: 500000}, far: {bitrate: 500000}, air: {bitrate: 500000, kind: wireless}}
pes:
  a: {node_id: 92, buses: [near], cpu: 1, ram: 1MiB, flash: 1MiB}
  b: {node_id: 93, buses: [near, far], cpu: 1, ram: 1MiB, flash: 1MiB}
  c: {node_id: 94, buses: [far, air], cpu: 1, ram: 1MiB, flash: 1MiB}
  d: {node_id: 95, buses: [air], cpu: 1, ram: 1MiB, flash: 1MiB}
modules:
  plain: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
  m: {runs_on: [a, c], cpu: 0.1, ram: 1KiB, rate_hz: 10, checkpoint: {bytes: 16, hz: 5, max_age_ms: 900}}
  n: {runs_on: [c, d], cpu: 0.1, ram: 1KiB, rate_hz: 10, checkpoint: {bytes: 8, hz: 2, max_age_ms: 900}}
functions: {f: {output: m}, g: {output: n}, h: {output: plain}}
"""
    compiler = Compiler(loads(text, "kept.dg.yaml"))
    told = {pe: [(one.module, one.number, one.towards) for one in compiler.table(pe).checkpoints] for pe in "abcd"}
    assert told == {
        "a": [(1, 0, ((94,),))],
        "b": [(1, 0, ((92,), (94,)))],
        "c": [(1, 0, ((92,), ())), (2, 1, ((), ()))],  # no state crosses a radio
        "d": [(2, 1, ((),))],
    }
    (of_a,), (of_b,) = compiler.table("a").checkpoints, compiler.table("b").checkpoints
    assert (of_a.data_bytes, of_a.period_ns, of_a.gap_ns, of_a.max_age_ns) == (16, 200 * 10**6, 10**6, 900 * 10**6)
    assert of_a.late_ns is not None
    assert of_b.late_ns is not None
    assert of_a.late_ns > of_b.late_ns > 4 * 10**6
    assert compiler.table("d").checkpoints[0].late_ns == 0


def test_a_bus_that_may_be_full_gives_a_state_no_bound() -> None:
    text = """
dg: 1
name: full
buses: {can0: {bitrate: 500000, max_load: 1}}
pes:
  a: {node_id: 92, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}
  b: {node_id: 93, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}
modules: {m: {cpu: 0.1, ram: 1KiB, rate_hz: 10, checkpoint: {bytes: 16, hz: 5, max_age_ms: 900}}}
functions: {f: {output: m}}
"""
    (told,) = Compiler(loads(text, "full.dg.yaml")).table("a").checkpoints
    assert (told.late_ns, told.towards) == (None, ((93,),))
