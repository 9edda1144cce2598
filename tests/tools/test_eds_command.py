"""`heronry eds`."""

from pathlib import Path

import pytest

from heronry_tools.cli import main
from heronry_wire.eds import eds_text


def test_the_eds_goes_to_standard_output_or_into_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["eds"]) == 0
    assert capsys.readouterr().out == eds_text()
    file = tmp_path / "pe.eds"
    assert main(["eds", "-o", str(file)]) == 0
    assert file.read_text() == eds_text()
