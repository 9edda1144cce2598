"""All that is fuzzed, by name."""

from collections.abc import Mapping

from heronry_tools.fuzz import agent_stories, manager_stories
from heronry_tools.fuzz.decoders import DECODERS
from heronry_tools.fuzz.target import Target

TARGETS: Mapping[str, Target] = {
    target.name: target for target in (*DECODERS, *agent_stories.STORIES, *manager_stories.STORIES)
}
