"""`heronry key`, and the commands that take a key."""

import resource
from pathlib import Path

import pytest

from heronry_agent.shell.cli import main as pe_agent
from heronry_tools.cli import main


def test_a_key_is_made_and_its_fingerprint_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "fleet.key"
    assert main(["key", str(file)]) == 0
    made = capsys.readouterr().out
    assert made.startswith(f"{file}: key ")
    assert file.read_text().strip() not in made
    assert main(["key", "--check", str(file)]) == 0
    assert capsys.readouterr().out == made


def test_a_key_is_never_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "fleet.key"
    main(["key", str(file)])
    assert main(["key", str(file)]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["manager", "demo"])
def test_a_key_that_others_can_read_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    file = tmp_path / "fleet.key"
    main(["key", str(file)])
    file.chmod(0o644)
    capsys.readouterr()
    assert main([command, "elevator_and_chute", "--key", str(file), "-i", "virtual", "-c", "x"]) == 2
    assert "can be read or changed by others (mode 0644)" in capsys.readouterr().err


def test_a_pe_agent_refuses_it_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "fleet.key"
    main(["key", str(file)])
    file.chmod(0o640)
    assert pe_agent(["--node", "92", "--key", str(file), "-i", "virtual", "-c", "x"]) == 2
    assert "mode 0640" in capsys.readouterr().err


def test_a_full_disk_leaves_no_empty_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "fleet.key"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        assert main(["key", str(file)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "File too large" in capsys.readouterr().err
    assert not file.exists()
