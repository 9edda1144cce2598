"""The check of DG7xx: the drivers that a spec names are loaded, and its devices are compared with what they declare.

A driver is searched for in the folder of the spec, in the present folder, and where Python finds packages. Code may do
anything when it is imported, so a process of its own imports it:

    python -m heronry_tools.analysis.check.drivers FOLDER DEVICES

DEVICES is a JSON list of [name, kind, driver, options, safe]. The process prints a line of JSON for each device: its
name, the code of the rule that it violates or null, and a sentence. If the process ends or hangs, the first device
without a line gets DG701, and the devices after it get nothing.
"""

import json
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Final

from heronry_agent.device_driver import ActuatorDriver, OptionError, checked_options
from heronry_agent.shell.driver_catalogue import UnknownDriverError, load_driver
from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_tools.analysis.check.driver_rules import (
    DRIVER_DOES_NOT_FIT,
    DRIVER_NOT_HERE,
    OPTIONS_ALONE,
    OPTIONS_DO_NOT_FIT,
)

LIMIT_S: Final = 20.0
_RULES: Final = {
    rule.code: (rule, key)
    for rule, key in (
        (DRIVER_NOT_HERE, "driver"),
        (DRIVER_DOES_NOT_FIT, "driver"),
        (OPTIONS_DO_NOT_FIT, "options"),
    )
}


def check(subject: Subject, findings: Findings) -> None:
    """Compare each device of a spec with its driver, and add a finding for what does not fit."""
    devices = subject.spec.devices.values()
    for device in devices:
        if device.options and device.driver is None:
            sentence = f"device '{device.name}' has options and no driver"
            findings.add(OPTIONS_ALONE, subject.place("devices", device.name, "options"), sentence, "name its driver")
    named = [[one.name, one.kind, one.driver, one.options, _text(one.safe)] for one in devices if one.driver]
    for name, code, sentence in _problems(Path(subject.file).resolve().parent, named) if named else ():
        rule, key = _RULES[code]
        findings.add(rule, subject.place("devices", name, key), f"device '{name}': {sentence}", rule.fix)


def _text(safe: object) -> str | None:
    return None if safe is None else str(safe)


def _problems(folder: Path, devices: list[list[Any]]) -> list[tuple[str, str, str]]:
    """Return name, code and sentence of each device that does not fit its driver."""
    command = [sys.executable, "-m", __name__, str(folder), json.dumps(devices)]
    try:
        ran = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=LIMIT_S, check=False)
        said, end = ran.stdout, f"its driver ends the process that loads it (exit code {ran.returncode})"
    except subprocess.TimeoutExpired as hung:
        said, end = hung.stdout or b"", f"its driver has not been loaded after {LIMIT_S:g} s"
    lines = [json.loads(line) for line in said.splitlines()]
    found = [(name, code, sentence) for name, code, sentence in lines if code is not None]
    if len(lines) < len(devices):
        found.append((devices[len(lines)][0], DRIVER_NOT_HERE.code, end))
    return found


def _problem(kind: str, driver: str, options: dict[str, Any], safe: str | None) -> tuple[str | None, str]:
    try:
        found = load_driver(driver)
        if issubclass(found, ActuatorDriver) is not (kind == "actuator"):
            other = "a sensor" if kind == "actuator" else "an actuator"
            return DRIVER_DOES_NOT_FIT.code, f"driver '{driver}' is for {other}"
        checked_options(found.OPTIONS, options)
    except UnknownDriverError as error:
        return DRIVER_NOT_HERE.code, str(error)
    except OptionError as error:
        return OPTIONS_DO_NOT_FIT.code, str(error)
    if issubclass(found, ActuatorDriver) and safe == "release" and found.release is None:
        return DRIVER_DOES_NOT_FIT.code, f"driver '{driver}' cannot release"
    return None, ""


def main(folder: str, devices: str) -> None:
    """Load the drivers one by one, and print a line about each device."""
    sys.path[:0] = [folder, str(Path.cwd())]
    out = sys.stdout
    for name, *rest in json.loads(devices):
        with redirect_stdout(sys.stderr):
            code, sentence = _problem(*rest)
        print(json.dumps([name, code, sentence]), file=out, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
