"""Random kills of modules and agents, on real processes: each failure stays local, and the system reacts to it.

    python -m lab.partition_kills [--spec elevator_and_chute] [--kills 1000] [--seed 1] [--rest 0.5]

Flies the spec on the software bus and injects faults (`campaign`). Every fault must end as the spec declares: the
modules are restarted, given up, or replaced by a new plan; and no other process may end. Exit code 1 otherwise.
"""

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from random import Random

from heronry_tools.console.errors import exit_code
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from lab.partition_kills.campaign import Campaign
from lab.slow_spec import slow_spec


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; gives the exit code."""
    parser = argparse.ArgumentParser(
        description="Kill modules and agents at random, and check the reaction to each kill."
    )
    parser.add_argument("--spec", default="elevator_and_chute", metavar="SPEC", help="default elevator_and_chute")
    parser.add_argument("--kills", type=int, default=1000, metavar="N", help="default 1000")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default 1")
    parser.add_argument("--heartbeat-ms", type=int, default=100, metavar="MS", help="of every bus (default 100)")
    parser.add_argument(
        "--rest", type=float, default=0.5, metavar="SECONDS", help="longest pause between two faults (default 0.5)"
    )
    arguments = parser.parse_args(argv)
    with ExitStack() as stack:
        folder = run_folder()
        file = slow_spec(arguments.spec, folder, heartbeat_ms=arguments.heartbeat_ms)
        spec = load_spec(str(file))
        fleet = stack.enter_context(Fleet(spec, file, folder))
        fleet.start_buses(choose(spec, fleet.folder, {}, None, prefer_vcan=False))
        random = Random(arguments.seed)
        campaign = Campaign(spec, fleet, EventStream(fleet.start_manager()), random)
        progress = stack.enter_context(Progress())
        campaign.begin()
        progress.begin("kills", arguments.kills)
        for _ in range(arguments.kills):
            campaign.inject()
            campaign.rest(random.uniform(0.0, arguments.rest))
            progress.step()
    for (way, became), times in sorted(campaign.became.items()):
        print(f"{times:6} {way}: {became}")
    print(f"{campaign.lost_unkilled:6} PEs lost without an injected fault (their heartbeats came late)")
    for failure in campaign.failures:
        print(f"FAILURE: {failure}")
    return 1 if campaign.failures else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "partition_kills"))
