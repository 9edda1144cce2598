"""A manager's status and events, the tables and slices for its PEs, and what it remembers over a restart."""

from collections import Counter
from typing import Any
from zlib import crc32

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, hosts_when_all_is_up
from heronry_dg.traffic import identifiers
from heronry_manager import events
from heronry_manager.core.memory import Latched
from heronry_manager.core.tables import Compiler
from heronry_manager.core.vocabulary import AskStatus, ClearElement, EnterPhase, FailElement
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.planning import best_plan
from heronry_wire.canopen_objects import COUNTERS, MODULE_FAILURES
from heronry_wire.configuration_slice import Slice, decode_slice
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkReport, LinkState
from heronry_wire.identifiers import GATEWAY_IDS, sdo_request_id
from heronry_wire.management import Alive, ElementKind, FaultCode, Prepare, Step
from heronry_wire.state_frames import PeState
from lab.conformance.manager_under_test import ManagerUnderTest, example
from lab.conformance.player import MS, demand, equal
from lab.peers import PlayedObjects


def _status(manager: ManagerUnderTest) -> dict[str, Any]:
    status = manager.accept(AskStatus()).status
    assert status is not None
    return dict(status)


def the_status_tells_of_pes_faults_functions_and_buses() -> None:
    """The status has every PE, the latched faults, the served functions, and the planned load of the buses."""
    manager = ManagerUnderTest()
    manager.run(50)
    early = _status(manager)
    equal((early["epoch"], early["stage"], early["next"], early["buses"]), (None, None, None, {}), "at the start")
    equal(early["manager"]["state"], "listening", "its state at the start")
    equal(early["functions"]["elevator"]["why_not"], "nothing runs yet", "why the elevator is not served")
    manager.flies()
    status = _status(manager)
    equal((status["epoch"], status["stage"], status["next"]), (manager.lease().epoch, "done", None), "epoch and stage")
    told = status["manager"]
    equal((told["node"], told["term"], told["state"], told["advises"]), (126, 1, "active", False), "itself")
    equal((told["planning"], told["journal"], told["key"]), (False, None, None), "what it does")
    flight = status["pes"]["flight"]
    equal((flight["state"], flight["why"], flight["losses"], flight["held_down_for_ns"]), ("up", None, 0, None), "a PE")
    equal((flight["epoch"], flight["runs"], flight["authentic"]), (status["epoch"], "ACTIVE", None), "what it runs")
    elevator = status["functions"]["elevator"]
    equal((elevator["wanted"], elevator["criticality"], elevator["served"]), (True, "A", True), "the elevator")
    demand(status["buses"]["can0"]["bits_per_s"] > 0, "the planned load of the bus")
    manager.emergency("tail_a", ElementKind.DEVICE, 1, 7)
    manager.run(250)
    (latched,) = _status(manager)["latched"]
    equal((latched["element"], latched["by"], latched["detail"]), ("device:elevator_servo_1", "tail_a", 7), "latched")
    demand(240 * MS < latched["for_ns"] < 252 * MS, f"latched for {latched['for_ns']} ns")
    tail = manager.pes["tail_b"]
    tail.speaks = False
    manager.run(100)
    lost = _status(manager)["pes"]["tail_b"]
    equal((lost["state"], lost["losses"], lost["epoch"]), ("down", 1, None), "a PE that is lost")
    demand("silent" in lost["why"], "why it is lost")
    tail.speaks = True
    manager.run(60)
    waiting = _status(manager)["pes"]["tail_b"]
    equal(waiting["state"], "returning", "a PE that is back")
    demand(130 * MS < waiting["held_down_for_ns"] < 180 * MS, f"held down for {waiting['held_down_for_ns']} ns more")


def the_status_tells_of_radios_and_phases() -> None:
    """The status has the reports of gateways, and the phases that no running module requests."""
    manager = ManagerUnderTest(example("radio_link"))
    manager.run(1500)
    unheard = _status(manager)["links"]["radio"]
    equal((unheard["state"], unheard["limit"], unheard["usable"]), ("unheard", 1000, None), "a radio without a report")
    report = LinkReport(manager.pes["comms"].node, LinkState.UP, 1, 990, 98, 3, 4)
    manager.main.say(Frame(GATEWAY_IDS[0], report.encode()))
    manager.run(5)
    link = _status(manager)["links"]["radio"]
    told = link["state"], link["limit"], link["usable"], link["delivered"], link["queued"], link["dropped"]
    equal(told, ("up", 1000, 990, 98, 3, 4), "a radio")


def a_lost_channel_is_reported() -> None:
    """It is reported once, until it is back, or until no node has reported it for three and a half seconds."""
    manager = ManagerUnderTest(example("replicated_bus"))
    pe = next(iter(manager.pes))
    manager.run(50)
    manager.emergency(pe, ElementKind.CHANNEL, 0, 1, FaultCode.CHANNEL_LOST)
    manager.run(5)
    equal(manager.told(events.ChannelLost), [], "lost channels that a listening manager reports")
    manager.flies()
    bus = manager.spec.manager.bus
    before = len(manager.plan_requests())

    def tell(number: int, code: FaultCode = FaultCode.CHANNEL_LOST, index: int = 0) -> None:
        manager.emergency(pe, ElementKind.CHANNEL, index, number, code)
        manager.run(5)

    tell(1)
    tell(1)
    equal([one.channel for one in manager.told(events.ChannelLost)], [f"{bus}.1"], "channels lost")
    equal(_status(manager)["channels"][f"{bus}.1"], [pe], "nodes that lack it")
    for number, index in ((0, 0), (3, 0), (1, 7)):
        tell(number, index=index)
    equal(len(manager.told(events.ChannelLost)), 1, "channels lost, after some that there are not")
    tell(1, FaultCode.CHANNEL_BACK)
    tell(1, FaultCode.CHANNEL_BACK)
    equal([one.channel for one in manager.told(events.ChannelBack)], [f"{bus}.1"], "channels back")
    tell(2)
    told_ns = manager.now_ns - 5 * MS
    manager.run_until(told_ns + 3480 * MS)
    equal(_status(manager)["channels"][f"{bus}.2"], [pe], "nodes that lack it after 3.48 s")
    manager.run_until(told_ns + 3530 * MS)
    equal(_status(manager)["channels"][f"{bus}.2"], [], "nodes that lack it after 3.53 s")
    equal(len(manager.told(events.ChannelBack)), 2, "channels back")
    equal(len(manager.plan_requests()), before, "plans requested")
    equal(manager.told(events.FaultReported), [], "faults")


def a_restart_goes_on_with_what_runs() -> None:
    """Where the PEs run the journal's configuration, it is adopted, with phase, faults and quarantines: no PREPARE."""
    first = ManagerUnderTest().flies()
    first.emergency("tail_b", ElementKind.DEVICE, 2, 1)  # the servo that is not used
    first.run(300)
    lease = first.lease()
    for change, adopted in (
        ({}, True),
        ({"tail_b": (PeState.UNCONFIGURED, 0, 0)}, True),
        ({"flight": (PeState.ACTIVE, lease.epoch, 0x99)}, False),
        ({"flight": (PeState.ACTIVE, lease.epoch + 1, lease.digest)}, False),
        ({"flight": (PeState.BROKEN, lease.epoch, lease.digest)}, False),
        (dict.fromkeys(first.pes, (PeState.UNCONFIGURED, 0, 0)), False),
    ):
        manager = ManagerUnderTest(disk=_copy(first))
        for name, pe in first.pes.items():
            played = manager.pes[name]
            played.state, played.epoch, played.digest = change.get(name, (pe.state, pe.epoch, pe.digest))
            played.runs = pe.runs if played.epoch else (0, 0)
        manager.run(600)
        told = [one.epoch for one in manager.told(events.Adopted)]
        equal(told, [lease.epoch] if adopted else [], f"adopted with {change}")
        equal(manager.lease().term, 3, "term after a restart")
        epochs = [one.epoch for _, one in manager.said(Prepare)]
        if not change:
            equal(epochs, [], "epochs after a restart")
            equal(
                [one.in_background for one in manager.plan_requests()],
                [True],
                "requests after a restart",
            )
        demand(adopted or min(epochs) > lease.epoch, f"epochs after a restart: {epochs}")
        equal([one["element"] for one in _status(manager)["latched"]], ["device:elevator_servo_2"], "latched")
        demand(manager.lease().step is Step.GO_ALL, f"with {change} it comes to no end")


def _copy(manager: ManagerUnderTest) -> Disk:
    """Copy the disk of a manager."""
    return Disk(manager.spec, manager.disk.data)


def a_restart_believes_no_damaged_line() -> None:
    """A line whose checksum is wrong, or that is no JSON, has no effect."""
    first = ManagerUnderTest().flies()
    first.emergency("tail_b", ElementKind.DEVICE, 2, 1)
    first.run(300)
    data, no_json = first.disk.data, b"[9,"
    for damaged, latched in (
        (data.replace(b"elevator_servo_2", b"elevator_servo_1"), []),
        (data + b"%08x %s\n" % (crc32(no_json), no_json), ["device:elevator_servo_2"]),
    ):
        demand(damaged != data, "the test has damaged nothing")
        manager = ManagerUnderTest(disk=Disk(first.spec, damaged))
        manager.run(600)
        equal([one["element"] for one in _status(manager)["latched"]], latched, "latched after a damaged journal")
        equal(manager.lease().term, 3, "term after a damaged journal")


def a_restart_remembers_the_phase_and_the_failed_pes() -> None:
    """A PE that the operator has failed stays out, and the phase is the one that was entered."""
    first = ManagerUnderTest(example("phases")).flies()
    phases = list(first.spec.phases)
    first.accept(EnterPhase(phases[1]))
    failed = list(first.pes)[-1]
    first.accept(FailElement(f"pe:{failed}"))
    first.run(400)
    disk = _copy(first)
    disk.opened()  # a restart before this one has made it short
    manager = ManagerUnderTest(first.spec, disk=disk)
    manager.run(800)
    equal(manager.plan_requests()[-1].now.phase, phases[1], "phase after a restart")
    demand(f"pe:{failed}" in manager.plan_requests()[-1].now.down, "a failed PE is planned with")
    demand(all(manager.pes[failed].node not in alive.nodes for _, alive in manager.said(Alive)), "it is available")
    equal(_status(manager)["phase"], phases[1], "phase in the status")


def what_is_cleared_at_a_restart_is_started() -> None:
    """The new mastership still waits for a PE when a stopped module is cleared: an epoch follows, which starts it."""
    first = ManagerUnderTest(example("radio_link"))
    first.run(1500)
    running = best_plan(first.spec, Situation(), None).configuration.modules
    name = next(module for module, one in running.items() if first.pes[one.pe].name == "nav")
    for clears, is_back in ((False, False), (True, False), (True, True)):
        disk = _copy(first)
        disk.opened()
        disk.write(Latched(f"module:{name}", "nav", "MODULE_EXCEPTION", 0), 0)
        manager = ManagerUnderTest(first.spec, disk=disk)
        for pe in first.pes.values():
            played = manager.pes[pe.name]
            played.epoch, played.digest, played.state, played.runs = pe.epoch, pe.digest, pe.state, pe.runs
        manager.pes["ground"].speaks = False
        manager.run(300)
        if clears:
            equal(manager.plan_requests(), [], "plans requested while a PE is waited for")
            demand(manager.accept(ClearElement(f"module:{name}")).done, "it cannot be cleared")
        manager.pes["ground"].speaks = is_back
        manager.run(2000)
        demand(bool(manager.said(Prepare)), "no epoch follows")


def a_restart_remembers_what_was_cleared() -> None:
    """A fault or a quarantine that was cleared before the restart stays cleared."""
    first = ManagerUnderTest().flies()
    first.accept(FailElement("device:elevator_servo_2"))
    first.run(100)
    first.accept(ClearElement("device:elevator_servo_2"))
    tail = first.pes["tail_b"]
    for hold_ms in (200, 400):
        tail.speaks = False
        first.run(100)
        tail.speaks = True
        first.run(hold_ms + 60)
    manager = ManagerUnderTest(disk=_copy(first))
    manager.run(400)
    equal(_status(manager)["latched"], [], "latched after a restart")
    equal(manager.has_available(), {"flight", "tail_a", "tail_b"}, "available after a restart")


def a_plan_that_fits_a_smaller_radio_is_kept() -> None:
    """Where the running plan fits the radio's new share, no plan is requested; else one is."""
    manager = ManagerUnderTest(example("radio_link"))
    manager.run(1500)
    before = len(manager.plan_requests())
    bits = _status(manager)["buses"]["radio"]["bits_per_s"]
    radio = manager.spec.buses["radio"]
    for sequence, usable in enumerate((1000, 1000, 700, 700, 300, 300, 15, 15)):
        gateway = manager.pes["comms"].node
        said = LinkReport(gateway, LinkState.UP, sequence, usable, 100, 0, 0)
        manager.main.say(Frame(GATEWAY_IDS[0], said.encode()))
        manager.run(100)
        step = next(one for one in (1000, 600, 250, 0) if one <= usable)
        room = radio.bitrate * step / 1000 * float(radio.max_load - radio.reserve)
        fits = bits <= room or not (sequence % 2)
        equal(len(manager.plan_requests()) > before, not fits, f"a plan is requested at {usable}, for {bits} bit/s")


def tables_hold_what_the_spec_says() -> None:
    """The tables of all PEs of every example: modules, places and identifiers are those of the spec."""
    for name in ("demux_actuators", "radio_link", "n_version", "replicated_bus", "phases", "elevator_and_chute"):
        spec = example(name)
        for pe in spec.pes:
            _verify_table(spec, pe)


def _verify_table(spec: Spec, pe: str) -> None:
    table, own = Compiler(spec).table(pe), spec.pes[pe]
    equal((table.name, table.node_id, table.spec), (pe, own.node_id, spec.name), "whose table it is")
    equal((table.spec_digest, table.cpu_millis), (spec.digest, own.cpu_millis), "its spec and CPU")
    equal([port.bus for port in table.ports], list(own.buses), "ports")
    for port in table.ports:
        bus = spec.buses[port.bus]
        said = port.bitrate, port.heartbeat_ns, port.misses, port.channels, port.wireless
        equal(said, (bus.bitrate, bus.heartbeat_ns, bus.misses, bus.channels, bus.kind == "wireless"), port.bus)
        equal(port.data_per_mille, int(1000 * (bus.max_load - bus.reserve)), f"share of data on {port.bus}")
        near = {other.node_id for other in spec.pes.values() if port.bus in other.buses} - {own.node_id}
        demand(near <= set(port.nodes), f"{port.bus} leads to {port.nodes}, and has {near}")
    reached = [node for port in table.ports for node in port.nodes]
    equal(sorted(reached), sorted(p.node_id for p in spec.pes.values() if p.name != pe), f"nodes around {pe}")
    may = [m.name for m in spec.modules.values() if pe in hosts_when_all_is_up(spec, m)]
    equal([m.name for m in table.modules], may, f"modules of {pe}")
    equal(list(table.module_names), list(spec.modules), "names of modules")
    exclusive = {name for demux in spec.demuxes.values() for name in (*demux.branches, *demux.to)}
    outputs = {output for function in spec.functions.values() for output in function.outputs}
    for entry in table.modules:
        module = spec.modules[entry.name]
        moves = module.device is not None and spec.devices[module.device].kind == "actuator"
        told = entry.image, entry.device, entry.demux, entry.restarts, entry.ram
        most = max(mode.ram for mode in module.modes.values())
        equal(told, (module.image, module.device, module.name in exclusive, module.restarts, most), module.name)
        equal(entry.movable, len(hosts_when_all_is_up(spec, module)) > 1, f"{module.name} is movable")
        equal(entry.silent_output, module.name in outputs and not moves, f"{module.name} is a silent output")
        for mode, written in zip(entry.modes, module.modes.values(), strict=True):
            equal((mode.name, mode.rate_mhz, mode.cpu_millis), (written.name, written.rate_mhz, written.cpu_millis), "")
            leaves = [(path, leaf.variable, leaf.best, leaf.worst) for path, leaf in written.leaves()]
            equal([(one.path, one.variable, one.best, one.worst) for one in mode.leaves], leaves, "leaves")
            equal(dict(mode.gives), dict(written.gives), "what it gives")
    numbers = identifiers(spec)
    for source in table.sources:
        equal(source.identifier, numbers[source.module, source.variable], f"identifier of {source.variable}")
        rates = [m.rate_mhz for m in spec.modules[source.module].modes.values() if source.variable in m.gives]
        equal(source.period_ns, 10**12 // min(rates), f"longest period of {source.variable}")
    equal(len(table.sources), len(numbers), "sources")
    equal(
        [(d.name, d.node) for d in table.devices], [(d.name, spec.pes[d.pe].node_id) for d in spec.devices.values()], ""
    )
    equal([phase.name for phase in table.phases], list(spec.phases), "phases")
    for entry_, phase in zip(table.phases, spec.phases.values(), strict=True):
        when = phase.when
        wanted = None if when is None else (when.variable, when.hold_ns)
        equal(None if entry_.variable is None else (entry_.variable, entry_.hold_ns), wanted, "rule of a phase")
    first = [f for f in spec.functions.values() if f.criticality_in(spec.initial_phase()) == "A"]
    critical = {f"module:{output}" for function in first for output in function.outputs}
    named = set(table.flight_critical)
    demand(critical <= named, f"{critical} are critical")
    bolted = {f"device:{one.device}" for one in spec.modules.values() if one.device and f"module:{one.name}" in named}
    equal({one for one in named if one.startswith("device:")}, bolted, "devices that are flight-critical")


def slices_bring_a_source_to_every_reader_once() -> None:
    """Slices lead a source from its producer over gateways; no bus carries it twice, or without a reader behind it."""
    for name in ("radio_link", "n_version", "big_blue"):
        spec = example(name)
        slices = _slices(spec)
        told: Counter[tuple[int, str]] = Counter()  # how many PEs send a source on a bus
        for pe, part in slices.items():
            masks = [*part.publish.items(), *((source, mask) for source, (_, mask) in part.forward.items())]
            told.update((source, bus) for source, mask in masks for bus in _buses(spec, pe, mask))
        demand(set(told.values()) == {1}, f"of {name} some source is sent twice on a bus: {told}")
        read = set()
        for pe, part in slices.items():
            for source in (*part.remote, *part.forward):
                heard = [(source, bus) for bus in spec.pes[pe].buses if (source, bus) in told]
                out = set(_buses(spec, pe, part.forward.get(source, (0, 0))[1]))
                inward = [one for one in heard if one[1] not in out]
                equal(len(inward), 1, f"buses on which {pe} hears source {source}, of {name}")
                read.update(inward)
        equal(read, set(told), f"what is read or handed on, of {name}")


def _slices(spec: Spec) -> dict[str, Slice]:
    """Return the slice of each PE where nothing is down."""
    compiler = Compiler(spec)
    bodies = compiler.configuration(best_plan(spec, Situation(), None).configuration).slices
    found = {}
    for pe in spec.pes.values():
        modules = compiler.table(pe.name).modules
        leaves = {(one.index, number): len(mode.leaves) for one in modules for number, mode in enumerate(one.modes)}
        found[pe.name] = decode_slice(bodies[pe.node_id], leaves)
    return found


def _buses(spec: Spec, pe: str, mask: int) -> list[str]:
    return [bus for port, bus in enumerate(spec.pes[pe].buses) if mask >> port & 1]


def events_tell_the_course_of_a_reconfiguration() -> None:
    """From the loss on, the events come in order, with their causes and times."""
    manager = ManagerUnderTest().flies()
    manager.pes["tail_b"].speaks = False  # it runs nothing, so its loss causes nothing that comes later
    manager.run(300)
    manager.pes["tail_b"].speaks = True
    manager.run(400)
    manager.pes["tail_a"].speaks = False
    began_ns = manager.run(400)
    kinds = [one.kind for one in manager.events if one.t_ns > began_ns]
    wanted = ["pe_suspected", "pe_lost", "plan_requested", "plan_ready", "epoch_prepared", "epoch_step", "epoch_step"]
    equal(kinds, [*wanted, "reconfigured"], "events")
    decide_ns = manager.told(events.PlanReady, began_ns)[0].decide_ns
    demand(MS <= decide_ns < 2 * MS, f"the plan is there after {decide_ns} ns")
    done = manager.told(events.Reconfigured, began_ns)[0]
    equal(done.causes, ("pe:tail_a: silent for 3 heartbeat periods",), "causes")
    detect_ns, decide_ns, distribute_ns, activate_ns = (ns or 0 for ns in done.times_ns.by_name().values())
    demand(64 * MS < detect_ns < 67 * MS, f"detected in {detect_ns} ns")
    demand(MS <= decide_ns < 2 * MS, f"decided in {decide_ns} ns")
    demand(0 < distribute_ns < 10 * MS, f"distributed in {distribute_ns} ns")
    demand(20 * MS < activate_ns < 100 * MS, f"activated in {activate_ns} ns, with T_lease to wait for")
    equal((done.moved, done.started, done.stopped), ((), ("servo_driver_2",), ("servo_driver_1",)), "changes")


def why_a_module_failed_is_read_from_its_pe_and_told() -> None:
    """After an EMCY on a module, the reason that the PE stores is read by SDO, segment by segment, and told once."""
    objects = PlayedObjects()
    manager = ManagerUnderTest(objects=objects).flies()
    spec, pe = manager.spec, manager.pes["tail_a"]
    index = list(spec.modules).index("servo_driver_1")
    hosted = [one.name for one in spec.modules.values() if "tail_a" in hosts_when_all_is_up(spec, one)]
    text = b"ValueError: no such angle (servo.py:12)"
    objects.values[pe.node, MODULE_FAILURES, hosted.index("servo_driver_1") + 1] = text
    for _ in range(3):
        manager.emergency("tail_a", ElementKind.MODULE, index, 1, FaultCode.MODULE_RESTARTED)
        manager.run(20)
    (told,) = manager.told(events.ModuleFailed)
    equal((told.element, told.by, told.text), ("module:servo_driver_1", "tail_a", text.decode()), "the reason")
    (kept,) = _status(manager)["failures"]
    equal(kept["text"], text.decode(), "the reason in the status")
    demand(40 * MS < kept["for_ns"] < 62 * MS, f"told {kept['for_ns']} ns before the status")


def standstills_are_read_from_a_pe_that_was_not_heard() -> None:
    """The counters of a PE are read when it was silent, and told when they have grown."""
    objects = PlayedObjects()
    manager = ManagerUnderTest(objects=objects)
    pe = manager.pes["tail_b"]

    def stood_still(times: int, last_ms: int, longest_ms: int) -> None:
        for sub_index, number in enumerate((times, times, last_ms, longest_ms), start=3):
            objects.values[pe.node, COUNTERS, sub_index] = number.to_bytes(4, "little")

    def misses_a_beat() -> None:
        pe.speaks = False
        manager.run(30)
        pe.speaks = True
        manager.run(60)

    stood_still(0, 0, 0)
    manager.flies()
    misses_a_beat()
    equal(manager.told(events.StoodStill), [], "told, though the PE has not stood still since it joined")
    stood_still(1, 44, 44)
    misses_a_beat()
    stood_still(2, 300, 300)
    misses_a_beat()
    told = [(one.by, one.for_ns // MS, one.times) for one in manager.told(events.StoodStill)]
    equal(told, [("tail_b", 44, 1), ("tail_b", 300, 2)], "the standstills")
    objects.values.clear()
    pe.speaks = False
    manager.run(100)
    pe.speaks = True
    manager.run(100)  # it is heard again, and gives no answer
    stood_still(3, 500, 500)
    manager.run(300)
    equal(manager.told(events.StoodStill)[-1].for_ns, 500 * MS, "told when the PE joins")
    standstills = _status(manager)["pes"]["tail_b"]["standstills"]
    equal(standstills, {"times": 3, "long_times": 3, "last_long_ms": 500, "longest_ms": 500}, "in the status")


def another_sdo_client_goes_first() -> None:
    """A manager leaves a PE to another client until that client has been silent, and reads other PEs meanwhile."""
    objects = PlayedObjects()
    manager = ManagerUnderTest(objects=objects).flies()
    pe = manager.pes["tail_a"]
    objects.asked.clear()
    manager.main.say(Frame(sdo_request_id(pe.node), bytes(8)))
    manager.run(2)
    index = list(manager.spec.modules).index("servo_driver_1")
    manager.emergency("tail_a", ElementKind.MODULE, index, 1, FaultCode.MODULE_RESTARTED)
    manager.run(900)
    equal([one for one in objects.asked if one[0] == pe.node], [], "read while another client may go on")
    manager.run(200)
    demand(bool([one for one in objects.asked if one[0] == pe.node]), "the PE is read afterwards")
