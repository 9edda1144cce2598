"""The flights that every mutant has to pass; each is a command that reports by itself whether it went well.

    conformance   one real node alone, with the rest of the aircraft played by the test
    scenario      every file of tests/scenarios: its expectations, its golden trace, and all oracles
    sim           flights whose faults are drawn from a seed: the oracles alone

The process that flies a flight imports the flight code late, since that code may have a defect.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from heronry_dg import loader
from heronry_dg.model import Spec
from heronry_tools.console.spec_files import spec_path

KINDS = ("conformance", "scenario", "sim")


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight; as text the command that flies it, in the folder of the checkout."""

    what: str  # one of KINDS
    file: Path  # conformance test, scenario, or spec
    seed: int = 0
    seconds: float = 0.0
    kinds: tuple[str, ...] = ()  # of faults, where not all
    loss: float = 0.0

    def __str__(self) -> str:
        if self.what == "conformance":
            return f"python -m lab.conformance {self.file}"
        words = ["heronry", self.what, str(self.file)]
        if self.what == "sim":
            words += ["--seed", str(self.seed), "--seconds", f"{self.seconds:g}"]
            words += [word for kind in self.kinds for word in ("--kind", kind)]
            words += ["--loss", f"{self.loss:g}"] if self.loss else []
        return " ".join(words)


@dataclass(frozen=True, slots=True)
class Landed:
    """The result of a flight: its first failure, if any, and the digest of all its frames, if it was kept."""

    wrong: str | None
    digest: str = ""


class Specs:
    """Reads each spec once, also for mutants: the loader uses no core."""

    def __init__(self) -> None:
        self._known: dict[Path, Spec] = {}
        self._read = loader.load

    def keep(self, flight: Flight, checkout: Path) -> None:
        """Read the spec of a flight; conformance tests use specs of other flights."""
        if flight.what == "conformance":
            return
        name = str(flight.file)
        if flight.what == "scenario":
            lines = (checkout / flight.file).read_text(encoding="utf-8").splitlines()
            name = next(line.split()[1] for line in lines if line.startswith("spec "))
            name = str(flight.file.parent / name) if Path(name).suffix else name
        self.load(checkout / spec_path(name))

    def load(self, path: str | Path) -> Spec:
        """Return the spec that was read from this path."""
        file = Path(path).resolve()
        if file not in self._known:
            self._known[file] = self._read(file)
        return self._known[file]

    def take_over(self) -> None:
        """Replace the loader, in a process that does nothing but fly."""
        loader.load = self.load


def flights(checkout: Path) -> list[Flight]:
    """Return every flight that a mutant has to pass."""
    from lab.conformance.conformance_tests import CONFORMANCE_TESTS  # noqa: PLC0415 - flight code: see head

    conformance_tests = (Flight("conformance", Path(name)) for name in CONFORMANCE_TESTS)
    scenarios = sorted((checkout / "tests" / "scenarios").glob("*.scenario"))
    return [*conformance_tests, *(Flight("scenario", file.relative_to(checkout)) for file in scenarios), *_drawn()]


def _drawn() -> Iterator[Flight]:
    examples = Path("dg_specs", "examples")
    for name, seeds in _DRAWN.items():
        for seed in range(seeds):
            yield Flight("sim", examples / f"{name}.dg.yaml", seed, 4.0)
    for name in ("demux_actuators", "radio_link"):
        yield Flight("sim", examples / f"{name}.dg.yaml", 0, 3.0, kinds=("attack", "crash", "manager_crash"))


_DRAWN = {"demux_actuators": 2, "triplex_voting": 1, "fail_over": 1, "radio_link": 2, "n_version": 1, "phases": 1}


def fly(flight: Flight, checkout: Path) -> Landed:
    """Fly; an exception of the flight code is a failure."""
    try:
        match flight.what:
            case "conformance":
                return _conformance_test(str(flight.file))
            case "scenario":
                return _fly_scenario(checkout / flight.file)
            case _:
                return _fly_drawn(flight, checkout)
    except Exception as error:  # noqa: BLE001 - a defect may raise anything
        return Landed(f"{type(error).__name__}: {error}".partition("\n")[0][:200])


def _conformance_test(name: str) -> Landed:
    from lab.conformance.conformance_tests import conforms  # noqa: PLC0415 - flight code: see head

    return Landed(*conforms(name))


def _fly_scenario(file: Path) -> Landed:
    from heronry_tools.sim.scenario.in_simulator import fly as fly_script  # noqa: PLC0415 - flight code: see head
    from heronry_tools.sim.scenario.script import read_script  # noqa: PLC0415 - flight code: see head

    flown = fly_script(read_script(file))
    missed = next((f"'{one.expectation.text}': {one.seen}" for one in flown.verdicts if not one.holds), None)
    wrong = [*flown.violations[:1], *([missed] if missed else []), *(flown.differences or ())[3:4]]
    return Landed(wrong[0] if wrong else None, flown.digest)


def _fly_drawn(flight: Flight, checkout: Path) -> Landed:
    from heronry_dg.loader import load  # noqa: PLC0415 - flight code: see head
    from heronry_tools.sim.faults.drawing import drawn_faults  # noqa: PLC0415 - flight code: see head
    from heronry_tools.sim.flight.outcome import Scenario, play  # noqa: PLC0415 - flight code: see head

    spec = load(checkout / flight.file)
    faults = drawn_faults(spec, flight.seed, flight.seconds, flight.kinds)
    outcome = play(spec, Scenario(flight.seed, flight.seconds, faults, flight.loss, drawn=True))
    return Landed(str(outcome.violations[0]) if outcome.violations else None, outcome.digest)
