"""All targets of the fuzzer, by name."""

from collections.abc import Mapping

from lab.fuzz import agent_stories, manager_stories
from lab.fuzz.decoders import DECODERS
from lab.fuzz.target import Target

TARGETS: Mapping[str, Target] = {
    target.name: target for target in (*DECODERS, *agent_stories.STORIES, *manager_stories.STORIES)
}
