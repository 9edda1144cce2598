"""Events of a flight, as a manager tells them."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from heronry_dg.configuration import Running, Wire
from heronry_dg.plan_document import ObjectiveDocument, PlanDocument
from heronry_dg.plan_report import BusReport, FunctionReport, PeReport
from heronry_manager import events
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sources.recordings import open_recording
from heronry_tools.watch.recording import Recording
from heronry_wire.frame import LoggedFrame, format_log_line

MS = 1_000_000
PICTURES = Path("build/pictures")  # where tests keep what views look like
DATE_NS = 1_700_000_000_000_000_000
TIMES = events.Times(detect=60 * MS, decide=40 * MS, distribute=9 * MS, activate=5 * MS)


def plan(pe: str, **functions: str | None) -> PlanDocument:
    """A plan: where the attitude filter runs, and which functions run in which mode, or do not."""
    filtered = Running(pe, "fused", {"0": Wire("imu_driver_1", "x", 1)})
    return PlanDocument(
        spec=load_spec("big_blue").digest,
        phase="glide",
        down=(),
        limits={},
        priorities={},
        objective=ObjectiveDocument({"A": 0}, 0, 0, 0, 0, 0, 0),
        optimal=False,
        levels=(),
        modules={"attitude_filter": filtered, "flaps": filtered},  # the spec has no flaps
        functions={
            name: FunctionReport(mode is not None, mode, 100 if mode else 0, None if mode else "no")
            for name, mode in functions.items()
        },
        pes={pe: PeReport(70, 1000, 2000)},
        buses={"can0": BusReport(10_000, 0.25)},
    )


FIRST_PLAN = plan("nav", elevator="only", rudder="only", imaging=None)
SECOND_PLAN = plan("air", elevator="only", rudder=None, imaging="only")


def reconfigured(
    now_ns: int,
    epoch: int,
    cause: str,
    *,
    moved: tuple[str, ...] = (),
    started: tuple[str, ...] = (),
    stopped: tuple[str, ...] = (),
) -> events.Reconfigured:
    return events.Reconfigured(now_ns, epoch, (cause,), TIMES, moved, started, stopped)


START = [
    events.ManagerStarted(
        0,
        spec="big_blue",
        spec_digest=load_spec("big_blue").digest,
        node=126,
        term=3,
        bus="can0",
        phase="ascent",
        advises=False,
        key=None,
    ),
    events.Bus(1, name="can0", interface="softbus", channel="can0.sock", models="all but bit errors"),
    events.PeJoined(10 * MS, pe="nav", cause="first heard"),
    events.PeJoined(11 * MS, pe="air", cause="first heard"),
    events.PeAbsent(12 * MS, pe="ground", cause="not heard since the start"),
    events.PlanRequested(12 * MS, request=1, down=("pe:ground",), limits={}, phase="glide", causes=("pe:air joined",)),
    events.PlanReady(60 * MS, request=1, plan=FIRST_PLAN, decide_ns=48 * MS),
    events.EpochPrepared(60 * MS, epoch=1, digest="0000AB", contingency=0, pes=("nav", "air"), bytes=40),
    events.EpochStep(69 * MS, epoch=1, step="GO_ALL", waiting_for=()),
]
RUNS = reconfigured(74 * MS, 1, "pe:air joined", started=("attitude_filter",))
LOSS = [
    events.PeSuspected(1025 * MS, pe="nav", cause="a period was missed", silent_ns=25 * MS),
    events.PeLost(1065 * MS, pe="nav", cause="silent for 3 periods", last_heard_ns=1000 * MS),
    events.FaultReported(1066 * MS, element="device:pitot", by="air", detail=7, code="REPORTED"),
    events.PlanRequested(
        1066 * MS,
        request=2,
        down=("pe:ground", "pe:nav"),
        limits={},
        phase="glide",
        causes=("pe:nav",),
    ),
]
RECOVERY = [
    events.PlanFailed(1070 * MS, request=2, reason="the planner was restarted"),
    events.PlanRequested(
        2070 * MS,
        request=3,
        down=("pe:ground", "pe:nav"),
        limits={},
        phase="glide",
        causes=("pe:nav",),
    ),
    events.PlanReady(2100 * MS, request=3, plan=SECOND_PLAN, decide_ns=1030 * MS),
    events.EpochPrepared(2100 * MS, epoch=2, digest="0000AC", contingency=0, pes=("air",), bytes=20),
    events.EpochStep(2110 * MS, epoch=2, step="GO_ALL", waiting_for=()),
    reconfigured(2120 * MS, 2, "pe:nav", moved=("attitude_filter",)),
    events.PeHeardAgain(3000 * MS, pe="nav", cause="heard after a silence"),
]
END = [
    events.PeJoined(3200 * MS, pe="nav", cause="steady again"),
    events.PlanRequested(
        3200 * MS, request=4, down=("pe:ground",), limits={}, phase="glide", causes=("pe:nav joined",)
    ),
    events.PlanReady(3230 * MS, request=4, plan=SECOND_PLAN, decide_ns=30 * MS),
    events.PlanUnchanged(3230 * MS, request=4),
    events.JournalFailed(4990 * MS, problem="No space left on device"),
    events.JournalKept(4995 * MS, before="No space left on device"),
    events.SecondManager(5000 * MS, node=127, term=4),
    events.Stopped(5000 * MS, reason="manager 127 is active with the higher term 4"),
]


ALL = [*START, RUNS, *LOSS, *RECOVERY, *END]


def recorded_big_blue(file: Path) -> Path:
    """The log of a simulated flight: nav is lost and comes back, then a sensor sticks and tail_b is lost."""
    simulation = Simulation(load_spec("big_blue"), keep_trace=True)
    simulation.run_until(1000 * MS)
    simulation.fleet.kill("nav")
    simulation.run_until(1700 * MS)
    simulation.fleet.arrive("nav")
    simulation.run_until(2500 * MS)
    simulation.fleet.kill("tail_b")
    simulation.run_until(3200 * MS)
    dated = (LoggedFrame(DATE_NS + sent.end_ns, sent.bus, sent.frame) for sent in simulation.trace)
    file.write_text("".join(format_log_line(logged) + "\n" for logged in dated))
    return file


@cache
def big_blue_log() -> Path:
    """That log, made once for all tests of this process."""
    return recorded_big_blue(Path(mkdtemp(prefix="heronry-test-")) / "flight.log")


@cache
def big_blue() -> Recording:
    """That log as a feed."""
    return open_recording(big_blue_log(), "big_blue")
