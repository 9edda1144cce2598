"""The resources that modes take and PEs have, and the PEs on which each mode could run."""

from dataclasses import dataclass

from heronry_dg.situation import hosts_when_all_is_up
from heronry_manager.planner.greedy.numbering import Numbering

_WHOLE = 10**6  # a share of 1, as an integer


@dataclass(frozen=True, slots=True)
class Sizes:
    """The resources of modes and PEs: CPU in thousandths of a core, memories in bytes."""

    cpu: list[int]  # by mode
    ram: list[int]  # by mode
    flash: list[int]  # by module
    pe_cpu: list[int]
    pe_ram: list[int]
    pe_flash: list[int]
    hosts: list[int]  # by mode: the set of PEs that could carry it if nothing else ran there
    size: list[int]  # by mode: sum of its shares of all CPU, RAM and flash in the aircraft, in millionths


def sized_up(numbers: Numbering) -> Sizes:
    """Compute the resources that the modes of a spec take, and those that its PEs have."""
    pes = numbers.pes
    pe_cpu, pe_ram, pe_flash = [p.cpu_millis for p in pes], [p.ram for p in pes], [p.flash for p in pes]
    cpu, ram = [mode.cpu_millis for _, mode in numbers.modes], [mode.ram for _, mode in numbers.modes]
    flash = [module.flash for module in numbers.modules]
    takes = [(cpu[mode], ram[mode], flash[module]) for mode, module in enumerate(numbers.module_of)]
    has = list(zip(pe_cpu, pe_ram, pe_flash, strict=True))
    whole = [sum(all_of) or 1 for all_of in zip(*has, strict=True)]
    placed = [
        [numbers.pe_number[pe] for pe in hosts_when_all_is_up(numbers.spec, module)] if module.modes else []
        for module in numbers.modules
    ]
    hosts = [
        sum(1 << pe for pe in placed[module] if _fits(needed, has[pe]))
        for needed, module in zip(takes, numbers.module_of, strict=True)
    ]
    size = [sum(part * _WHOLE // all_of for part, all_of in zip(needed, whole, strict=True)) for needed in takes]
    return Sizes(cpu, ram, flash, pe_cpu, pe_ram, pe_flash, hosts, size)


def _fits(needed: tuple[int, int, int], there: tuple[int, int, int]) -> bool:
    return all(part <= room for part, room in zip(needed, there, strict=True))
