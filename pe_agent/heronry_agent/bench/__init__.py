"""The bench: the physical world that simulated devices read and move."""

from heronry_agent.bench.world import Bench, Failure

__all__ = ["Bench", "Failure"]
