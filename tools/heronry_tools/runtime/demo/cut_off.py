"""Why a PE whose process runs is not heard: the demo has killed every gateway on its way to the manager."""

from collections.abc import Collection

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors


def gateways_lost(spec: Spec, pe: str, killed: Collection[str]) -> list[str]:
    """Return the killed PEs without which no way leads from a PE to the manager's bus; none if there is a way.

    None either if there was no way before: then their kill is not the reason.
    """

    def reaches(down: Collection[str]) -> bool:
        left = survivors(spec, Situation(frozenset(f"pe:{one}" for one in down)))
        homes = (one.name for one in spec.pes.values() if spec.manager.bus in one.buses and one.name not in down)
        return any(home == pe or left.route(pe, home) is not None for home in homes)

    if not killed or reaches(killed) or not reaches(()):
        return []
    return [one for one in killed if reaches([other for other in killed if other != one])] or sorted(killed)
