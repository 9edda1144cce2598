"""All targets of the fuzzer, by name."""

from collections.abc import Mapping

from lab.fuzz import agent_stories, manager_stories
from lab.fuzz.decoders import DECODERS
from lab.fuzz.pages import PAGES
from lab.fuzz.recordings import RECORDINGS
from lab.fuzz.target import Target

TARGETS: Mapping[str, Target] = {
    target.name: target for target in (*DECODERS, *RECORDINGS, *PAGES, *agent_stories.STORIES, *manager_stories.STORIES)
}
