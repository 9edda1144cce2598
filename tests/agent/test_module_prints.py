"""What modules print: each line has the time and the name of its module."""

from io import StringIO

from heronry_agent.shell.log_allowance import LogAllowance
from heronry_agent.shell.module_prints import ModulePrints
from heronry_agent.shell.module_runner import ModuleRunner, Orders
from heronry_agent.shell.partition import Partition
from heronry_agent.shell.partition_messages import Start, Step, encode_orders
from heronry_wire.sansio import NEVER_NS


def test_a_line_goes_out_with_time_and_name_when_it_is_complete() -> None:
    under = StringIO()
    prints = ModulePrints(under, lambda: "12:00:00.000")
    prints.of("imu")
    print("a", end="", file=prints)
    assert under.getvalue() == ""
    print("b\nc", file=prints, flush=True)
    assert under.getvalue() == "12:00:00.000 module imu: ab\n12:00:00.000 module imu: c\n"


def test_a_line_that_a_module_has_begun_is_not_ended_by_another() -> None:
    under = StringIO()
    prints = ModulePrints(under, lambda: "T")
    prints.of("imu")
    print("begun", end="", file=prints)
    prints.of("imu")
    print(" on", end="", file=prints)
    prints.of("gps")
    print("x", file=prints)
    assert under.getvalue() == "T module imu: begun on\nT module gps: x\n"


def test_a_line_without_an_end_does_not_grow_for_ever() -> None:
    under = StringIO()
    prints = ModulePrints(under, lambda: "T")
    assert prints.writable()
    for _ in range(50):
        print("." * 1000, end="", file=prints)
    assert len(under.getvalue()) > 40_000


def test_a_module_that_prints_much_leaves_room_for_others() -> None:
    under = StringIO()
    prints = ModulePrints(under, lambda: "T")
    prints.of("imu")
    for _ in range(10_000):
        print("." * 100, file=prints)
    prints.of("gps")
    print("fix", file=prints)
    lines = under.getvalue().splitlines()
    assert len(under.getvalue()) < 200_000
    assert [line for line in lines if "left out" in line] == [
        "T module imu: prints more than 4096 bytes per second: what is beyond that is left out of the log"
    ]
    assert lines[-1] == "T module gps: fix"


def test_an_allowance_is_a_burst_a_rate_and_a_size_in_all() -> None:
    allowance = LogAllowance(1, 0)
    assert [allowance.take(100_000, 0), allowance.take(1, 0)] == [65_536, 0]
    assert allowance.take(100_000, 2_000_000_000) == 8192
    day_ns, given = 86_400_000_000_000, 0
    for day in range(1, 1000):
        given += allowance.take(100_000, day * day_ns)
    assert given + 65_536 + 8192 == 16 * 1024 * 1024


def test_a_partition_says_which_module_computes() -> None:
    named: list[str] = []
    partition = Partition(ModuleRunner(lambda: 0), named.append)
    orders = [Start(at, Orders(name, "no:Thing", "only", 1, False), ()) for at, name in enumerate(("imu", "gps"))]
    list(partition.accept(encode_orders([*orders, Step(0, 1, 0, NEVER_NS, None, ())])))
    assert named == ["imu", "gps", "imu"]
