"""A plan on paper: functions, PEs and buses as tables; coloured on a terminal that can, plain text anywhere else.

One description of the tables, two renderers. The plain one needs nothing installed, and its lines are for `grep` as
well: one function, one module of a PE and one bus a line.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import Survivors, survivors

_BAR = 5  # characters; wide tables must fit narrow terminals


@dataclass(frozen=True, slots=True)
class Bar:
    """A share of a capacity, and the two in words."""

    share: float
    text: str


@dataclass(frozen=True, slots=True)
class Bad:
    """A cell that is no good news."""

    text: str


Cell = str | Bar | Bad


@dataclass(frozen=True, slots=True)
class Table:
    """A table with one title row."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]


def print_plan(spec: Spec, plan: Plan) -> None:
    """Print a plan to standard output."""
    tables = list(_tables(spec, plan))
    if not (sys.stdout.isatty() and _print_rich(_headline(spec, plan), tables)):
        print(_headline(spec, plan))
        for table in tables:
            print()
            print("\n".join(_plain(table)))


def _headline(spec: Spec, plan: Plan) -> str:
    phase = f", phase {plan.now.phase}" if plan.now.phase is not None else ""
    down = f", down: {', '.join(sorted(plan.now.down))}" if plan.now.down else ", nothing down"
    limits = "".join(f", {element} at {float(100 * share):g} %" for element, share in sorted(plan.now.limits.items()))
    proof = "the best there is" if plan.optimal else "legal, not proven to be the best"
    served = plan.objective
    classes = ", ".join(f"{name} {points}" for name, points in zip("ABCD", served.critical, strict=True))
    return (
        f"{spec.name}{phase}{down}{limits}\n"
        f"{proof}: critical {classes}; utility {served.utility}; inputs {served.inputs}; changes {served.changes}; "
        f"branches {served.branches}; {served.bus_bits_per_s} bit/s; CPU {served.cpu_millis / 1000:.3f}"
    )


def _tables(spec: Spec, plan: Plan) -> Iterator[Table]:
    left = survivors(spec, plan.now)
    yield Table(("function", "class", "priority", "mode", "value", ""), list(_function_rows(spec, plan)))
    yield Table(("PE", "CPU", "RAM", "flash", "modules"), list(_pe_rows(spec, plan, left)))
    yield Table(("bus", "data, of what is left for it", "of the bit rate"), list(_bus_rows(plan, left)))


def _function_rows(spec: Spec, plan: Plan) -> Iterator[Sequence[Cell]]:
    for name, report in plan.functions.items():
        function = spec.functions[name]
        rank, priority = function.criticality_in(plan.now.phase), function.priority_in(plan.now.phase)
        if report.served:
            output = next(module for module in function.outputs if module in plan.configuration.modules)
            yield name, rank, str(priority), report.mode or "", str(report.value), f"served by {output}"
        elif priority == 0:
            yield name, rank, "0", "-", "-", "not wanted"
        else:
            yield name, rank, str(priority), "-", "-", Bad(f"NOT SERVED: {report.why_not}")


def _pe_rows(spec: Spec, plan: Plan, left: Survivors) -> Iterator[Sequence[Cell]]:
    for name, used in plan.pes.items():
        pe = spec.pes[name]
        if name not in left.pe_cpu_millis:
            yield name, "-", "-", "-", Bad("is down" if f"pe:{name}" in plan.now.down else "cannot be reached")
            continue
        cpu = left.pe_cpu_millis[name]
        modules = [
            module if len(spec.modules[module].modes) == 1 else f"{module} ({running.mode})"
            for module, running in plan.configuration.modules.items()
            if running.pe == name
        ]
        yield (
            name,
            _bar(used.cpu_millis, cpu, f"{used.cpu_millis / 1000:g}/{cpu / 1000:g}"),
            _bar(used.ram, pe.ram, _bytes(used.ram, pe.ram)),
            _bytes(used.flash, pe.flash),
            modules[0] if modules else "",
        )
        for module in modules[1:]:
            yield "", "", "", "", module


def _bus_rows(plan: Plan, left: Survivors) -> Iterator[Sequence[Cell]]:
    for name, used in plan.buses.items():
        if name not in left.bus_mbit_per_s:
            yield name, Bad("is down"), "-"
            continue
        capacity = left.bus_mbit_per_s[name] // 1000
        share = _bar(used.bits_per_s, capacity, f"{used.bits_per_s}/{capacity} bit/s")
        yield name, share, f"{used.load:.2%}"


def _bar(used: int, capacity: int, text: str) -> Bar:
    return Bar(used / capacity if capacity else 0.0, text)


def _bytes(used: int, capacity: int) -> str:
    for unit, size in (("M", 1 << 20), ("K", 1 << 10)):
        if capacity >= size:
            return f"{used / size:.3g}/{capacity / size:.4g}{unit}"
    return f"{used}/{capacity}"


def _plain(table: Table) -> Iterator[str]:
    """Aligned columns; the last one as long as it likes."""
    texts = [table.columns, *([_in_words(cell) for cell in row] for row in table.rows)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(table.columns) - 1)]
    for row in texts:
        cells = (text.ljust(width) for text, width in zip(row, [*widths, 0], strict=True))
        yield "  ".join(cells).rstrip()


def _in_words(cell: Cell) -> str:
    match cell:
        case Bar(share, text):
            return f"[{'#' * _filled(share):.<{_BAR}}] {text}"
        case Bad(text):
            return text
        case _:
            return cell


def _filled(share: float) -> int:
    """Length of a bar: nothing only for nothing, full only for full."""
    if share <= 0:
        return 0
    return min(_BAR if share >= 1 else _BAR - 1, max(1, round(share * _BAR)))


def _print_rich(headline: str, tables: Sequence[Table]) -> bool:
    """Print with rich; False where it is not installed."""
    try:
        from rich.box import SIMPLE_HEAD  # noqa: PLC0415 - an extra
        from rich.console import Console  # noqa: PLC0415
        from rich.table import Table as RichTable  # noqa: PLC0415
        from rich.text import Text  # noqa: PLC0415
    except ImportError:
        return False

    def rendered(cell: Cell) -> Text:
        match cell:
            case Bar(share, text):
                colour = "green" if share < 0.7 else "yellow" if share < 0.9 else "red"
                full = _filled(share)
                return Text.assemble(("█" * full, colour), ("░" * (_BAR - full), "dim"), f" {text}")
            case Bad(text):
                return Text(text, style="bold red")
            case _:
                return Text(cell)

    console = Console()
    console.print(Text(headline))
    for table in tables:
        rich_table = RichTable(box=SIMPLE_HEAD, pad_edge=False)
        for column in table.columns:
            rich_table.add_column(column, overflow="fold")
        for row in table.rows:
            rich_table.add_row(*map(rendered, row))
        console.print(rich_table)
    return True
