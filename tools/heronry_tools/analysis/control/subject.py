"""The graph on which a command about component graphs works: read from a file, or made of a spec and a plan."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.plan import check_names, read_configuration, read_situation
from heronry_dg.shipped import example_specs, shipped_spec_names, shipped_spec_path
from heronry_dg.situation import Situation, situation
from heronry_pcs.graph import Graph
from heronry_pcs.graph_files import SUFFIXES, load_graph
from heronry_pcs.plan_graph import managers_side, plan_graph
from heronry_pcs.shipped import shipped_graph_names, shipped_graph_path
from heronry_tools.console.errors import UserError
from heronry_tools.console.plan_argument import errors_name, read_text
from heronry_tools.console.spec_argument import FLOWN, SHIPPED
from heronry_tools.console.spec_files import load_spec

CRITICAL: Final = ("A", "B")  # classes of plants that a plan has to keep on a path


@dataclass(frozen=True, slots=True)
class Planned:
    """A spec with a configuration, and the situation for which the configuration was made."""

    spec: Spec
    now: Situation
    configuration: Configuration


@dataclass(frozen=True, slots=True)
class Subject:
    """A graph, and the plan from which it was derived, if there is one."""

    graph: Graph
    planned: Planned | None = None

    def first_side(self) -> str | None:
        """Return the manager's side, as `side:` and the name of a PE on it; None for a graph that was read from a file.

        Radios divide the PEs of a spec into sides. Of several least cuts, `least_cut` chooses the one that leaves as
        many leaves as possible on the side given here.
        """
        return managers_side(self.planned.spec) if self.planned is not None else None

    def critical_plants(self) -> frozenset[str] | None:
        """Return the plants that must be on a control path: those of class A and B of a spec.

        None for a graph that was read from a file, since it has no classes.
        """
        if self.planned is None:
            return None
        plants = self.planned.spec.plants.values()
        return frozenset(f"plant:{plant.name}" for plant in plants if plant.criticality in CRITICAL)


def load_subject(text: str, plan_file: str | None = None) -> Subject:
    """Load the graph or the spec that `text` names: a file, or the name of a shipped graph or spec.

    plan_file: the file with the plan, for a spec. None: the best plan of the spec with everything up is made.

    Raises UserError, SpecError or PlanError.
    """
    path = graph_path(text)
    if path is not None:
        if plan_file is not None:
            raise UserError(f"{text} is a graph, and --plan needs a spec: leave --plan out")
        return Subject(load_graph(path))
    if not Path(text).suffix and not Path(text).exists() and text not in (*SHIPPED, *FLOWN):
        graphs, specs = ", ".join(shipped_graph_names()), ", ".join((*SHIPPED, *FLOWN))
        raise UserError(f"'{text}' is neither a file, nor a shipped graph ({graphs}), nor a shipped spec ({specs})")
    planned = load_planned(load_spec(text), plan_file)
    return Subject(plan_graph(planned.spec, planned.configuration), planned)


def graph_path(text: str) -> Path | None:
    """Return the file of a graph, named by its path or by the name of a shipped graph; None for any other text."""
    if text.endswith(SUFFIXES):
        return Path(text)
    return shipped_graph_path(text) if text in shipped_graph_names() and not Path(text).exists() else None


def shipped_spec_of(plan: str) -> Spec | None:
    """Find the shipped spec for which a plan (JSON) was made, by the digest in the plan.

    None: the text is no plan, or no shipped spec has the digest.
    """
    try:
        digest = json.loads(plan)["spec"]
    except (ValueError, KeyError, TypeError):
        return None
    files = (*map(shipped_spec_path, shipped_spec_names()), *example_specs())
    return next((spec for spec in map(load, files) if spec.digest == digest), None)


def load_planned(spec: Spec, plan_file: str | None) -> Planned:
    """Read the plan in a file, or make the best plan with everything up; raises UserError."""
    if plan_file is None:
        from heronry_manager.planner.exact import plan  # noqa: PLC0415 - the solver is slow to import

        now = situation(spec)
        return Planned(spec, now, plan(spec, now).configuration)
    with errors_name(plan_file):
        text = read_text(plan_file)
        configuration = read_configuration(text)
        check_names(spec, configuration)
        return Planned(spec, read_situation(text, spec), configuration)
