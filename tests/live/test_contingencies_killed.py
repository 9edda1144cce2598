"""A sweep in several processes: killed for real and taken up again, and on a Dask cluster of real processes."""

import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_manager.planner.sweep import Question
from heronry_tools.analysis.campaign.crew import answers, crew
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError

pytestmark = pytest.mark.live

SCOPE = ["big_blue", "--faults", "1", "--kinds", "pe,bus", "--phase", "glide"]


def children_of(process: int) -> list[int]:
    tasks = Path(f"/proc/{process}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def whole_lines(file: Path) -> int:
    return file.read_bytes().count(b"\n") if file.exists() else 0


def test_a_killed_sweep_goes_on_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    undisturbed, killed = tmp_path / "undisturbed", tmp_path / "killed"
    assert main(["contingencies", *SCOPE, "-o", str(undisturbed), "--jobs", "2"]) == 0
    partial = Path(f"{killed}.partial")
    command = [sys.executable, "-m", "heronry_tools", "contingencies", *SCOPE, "-o", str(killed), "--jobs", "2"]
    with subprocess.Popen(command, start_new_session=True) as process:
        while whole_lines(partial) < 3:  # the head and two answers
            assert process.poll() is None, "it ended before it could be killed"
        workers = children_of(process.pid)
        process.send_signal(signal.SIGKILL)
    assert workers, "it plans in processes of its own"
    for worker in workers:
        while Path(f"/proc/{worker}/fd/0").exists():  # they end by themselves
            pass
    assert not killed.exists()
    capsys.readouterr()
    assert main(["contingencies", *SCOPE, "-o", str(killed), "--jobs", "2"]) == 0
    assert f"continuing {partial}" in capsys.readouterr().err
    assert killed.read_bytes() == undisturbed.read_bytes()
    assert not partial.exists()
    assert main(["contingencies", "--check", str(killed), "big_blue", "--jobs", "2"]) == 0


def test_a_crew_that_is_killed_is_one_sentence() -> None:
    spec = load(shipped_spec_path("elevator_and_chute"))
    questions = [Question(None, frozenset({one}), None) for one in elements(spec)]
    with crew(2) as executor:
        assert isinstance(executor, ProcessPoolExecutor)
        got = answers(spec, executor, questions)
        next(got)
        for process in list(executor._processes.values()):
            process.kill()
        with pytest.raises(UserError, match="repeat the command"):
            list(answers(spec, executor, questions))


@pytest.mark.filterwarnings("ignore")  # of what Dask does with its own
def test_a_dask_cluster_finds_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed")
    here, there = tmp_path / "here", tmp_path / "there"
    assert main(["contingencies", "elevator_and_chute", "-o", str(here), "--jobs", "1"]) == 0
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        assert main(["contingencies", "elevator_and_chute", "-o", str(there), "--scheduler", address]) == 0
    assert there.read_bytes() == here.read_bytes()


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("distributed")
    nowhere = "tcp://127.0.0.1:1"
    assert main(["contingencies", "elevator_and_chute", "-o", str(tmp_path / "f"), "--scheduler", nowhere]) == 2
    assert f"no Dask scheduler answers at {nowhere}" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_without_workers_is_not_waited_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=0, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        assert main(["contingencies", "elevator_and_chute", "-o", str(tmp_path / "f"), "--scheduler", address]) == 2
    assert f"the Dask scheduler at {address} has no workers; start some with: dask worker" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.soak  # test_demo.py kills a PE of big_blue in every run, and its plan is called by its number
def test_a_manager_flies_on_plans_made_ahead(tmp_path: Path) -> None:
    file = tmp_path / "chute.contingencies"
    assert main(["contingencies", "elevator_and_chute", "-o", str(file), "--faults", "1", "--jobs", "1"]) == 0
    demo = ["demo", "elevator_and_chute", "--contingencies", str(file), "--kill", "pe:tail_pe@0.5", "--for", "4"]
    command = [sys.executable, "-m", "heronry_tools", *demo]
    shown = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "heard on the bus at the end: parachute\n" in shown.stdout
