"""DG601: code that is found on this computer is loaded by `heronry check`, in a process of its own."""

from pathlib import Path

import pytest

from heronry_tools.analysis.check import images
from heronry_tools.cli import main

GOOD = "from heronry_agent.module import Module\n\n\nclass Estimator(Module):\n    pass\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a spec whose estimator is own_code:Estimator, which is not the present folder."""
    text = Path("dg_specs/elevator_and_chute.dg.yaml").read_text()
    spec = text.replace("state_estimator: {", "state_estimator: {image: 'own_code:Estimator', ")
    (tmp_path / "own.dg.yaml").write_text(spec)
    monkeypatch.setenv("COLUMNS", "300")
    return tmp_path


def found(folder: Path, capsys: pytest.CaptureFixture[str], *more: str) -> str:
    assert main(["check", str(folder / "own.dg.yaml"), "--select", "DG6", "--format", "concise", *more]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        (GOOD, None),
        (GOOD.replace("Estimator", "Estimater"), "own_code has no class Estimator derived from"),
        ("import no_such_package\n", "cannot import own_code (No module named 'no_such_package')"),
        ("x = 1 / 0\n", "the code cannot be imported: ZeroDivisionError: division by zero (own_code.py:1)"),
        ("print('x')\nimport os\nos._exit(3)\n", "image 'own_code:Estimator': it ends the process (exit code 3)"),
        ("import time\ntime.sleep(60)\n", "image 'own_code:Estimator': it has not been loaded after 1 s"),
    ],
)
def test_what_cannot_be_loaded_here_is_a_warning(
    code: str, problem: str | None, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if "sleep" in code:
        monkeypatch.setattr(images, "LIMIT_S", 1.0)
    (folder / "own_code.py").write_text(code)
    said = found(folder, capsys)
    if problem is None:
        assert "DG601" not in said
    else:
        assert "DG601 warning: module 'state_estimator' cannot run: " in said
        assert problem in said
        assert "see: heronry module try own_code:Estimator" in said


def test_code_that_is_not_here_and_a_fast_check_say_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "DG601" not in found(folder, capsys)
    (folder / "own_code.py").write_text("x = 1 / 0\n")
    assert "DG601" not in found(folder, capsys, "--fast")
