"""What runs on a PE needs no flight dynamics; a flight without them says what to install."""

import subprocess
import sys

from heronry_tools.cli import main
from heronry_tools.fly.avionics import CATALOGUE

CODE = """
import importlib, sys
from heronry_tools.fly.avionics import CATALOGUE
for place in CATALOGUE.values():
    importlib.import_module(place.partition(":")[0])
import heronry_tools.fly.live.driver
print(sorted({name.partition(".")[0] for name in sys.modules} & {"jsbsim", "numpy", "ortools", "yaml", "pydantic"}))
"""


def test_the_images_and_the_driver_of_a_pe_import_no_flight_dynamics():
    assert CATALOGUE
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_flight_without_the_extra_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    assert main(["fly", "eav"]) == 2
    assert 'pip install "heronry[manager,fly]"' in capsys.readouterr().err
