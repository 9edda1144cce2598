"""DG0xx, rules about the file: it can be read, is plain YAML, and its comments for `heronry check` are valid.

yaml_source.py and plain_scalars.py check these rules while the file is read, and check/comments.py checks DG09x.
How a rule is added is shown in rule.py.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DISPLAY, DRIVER

FAMILY: Final = Family("DG0", "the file and its YAML", fast=True)

_SURPRISE: Final = "A spec must have one meaning, whichever program reads it; YAML 1.1 and 1.2 read this differently."

UNREADABLE = FAMILY.stop(
    "DG001",
    "unreadable-file",
    what="The file cannot be read.",
    why="A spec that does not exist, or that may not be read, cannot be checked.",
    fix="Check the path and the permissions; name a file, or a folder that holds *.dg.yaml files.",
    bad="(a path to nothing)",
    good="(a path to a file)",
)
TOO_LARGE = FAMILY.stop(
    "DG002",
    "file-too-large",
    what="The file is larger than any spec can sensibly be.",
    why="Specs come from anywhere. A file beyond the limits is refused before it costs time or memory.",
    fix="A spec is a short text: look for data that was pasted into it, or divide the system into two specs.",
    bad="(a file with more bytes or values than the limits)",
    good="(a text written by hand)",
)
NOT_UTF8 = FAMILY.stop(
    "DG003",
    "not-utf8",
    what="A byte of the file is not UTF-8.",
    why="In any other encoding the same bytes are other characters, so names and units could change by being copied.",
    fix="Save the file as UTF-8.",
    bad="name: caf\udce9\n",
    good="name: cafe\n",
)
INVISIBLE = FAMILY.stop(
    "DG004",
    "control-character",
    what="The file holds a control character, or another character that YAML does not allow.",
    why="Such a character is invisible in an editor, and can make a terminal show something else than the text.",
    fix="Remove it.",
    bad="name: ba\x07d\n",
    good="name: bad\n",
)
SYNTAX = FAMILY.stop(
    "DG005",
    "not-yaml",
    what="The file is not YAML.",
    why="A bracket, quote, comma or colon is missing, or lines are indented with tabs.",
    fix="Look at the place shown, and at the beginning of the part around it.",
    bad="contingency: {faults: 1\n",
    good="contingency: {faults: 1}\n",
)
EMPTY = FAMILY.stop(
    "DG006",
    "empty-file",
    what="The file is empty, or holds comments alone.",
    why="An empty file is not a spec; the program that generated it may have failed.",
    fix="Begin with `dg: 1`.",
    bad="# nothing yet\n",
    good="dg: 1\nbuses: {can0: {bitrate: 1000000}}\n",
)
TOO_DEEP = FAMILY.stop(
    "DG007",
    "too-deep",
    what="A part of the file is nested deeper than any spec needs.",
    why="A hostile file with enough levels could exhaust the memory of the program that reads it.",
    fix="Give a part of the expression a name under `gates:`, and use the name.",
    bad=f"contingency: {'[' * 64}{']' * 64}\n",
    good="contingency: {faults: 1}\n",
)
DIRECTIVE = FAMILY.stop(
    "DG010",
    "yaml-directive",
    what="The file has a YAML directive, such as %YAML or %TAG.",
    why="Directives change how the rest of the file is read; a spec must be read the same everywhere.",
    fix="Remove the line.",
    bad="%YAML 1.1\n---\ndg: 1\nbuses: {can0: {bitrate: 1000000}}\n",
    good="---\ndg: 1\nbuses: {can0: {bitrate: 1000000}}\n",
)
SECOND_DOCUMENT = FAMILY.stop(
    "DG011",
    "second-document",
    what="A second YAML document begins in the file.",
    why="Many programs read the first document and skip the rest without a message.",
    fix="Write one file per spec, without `---` between parts.",
    bad="dg: 1\nbuses: {can0: {bitrate: 1000000}}\n---\ndg: 1\n",
    good="dg: 1\nbuses: {can0: {bitrate: 1000000}}\n",
)
ALIAS = FAMILY.stop(
    "DG012",
    "yaml-alias",
    what="A value is a YAML alias (`*name`).",
    why="A few lines with aliases can stand for a huge tree, and a change in one place has unseen effects elsewhere.",
    fix="Write the value out. For a gate expression that is used again, give it a name under `gates:`.",
    bad="contingency: *other\n",
    good="contingency: {faults: 1}\n",
)
ANCHOR = FAMILY.stop(
    "DG013",
    "yaml-anchor",
    what="A value carries a YAML anchor (`&name`).",
    why="Anchors exist for aliases, which a spec does not have.",
    fix="Remove it.",
    bad="contingency: &usual {faults: 1}\n",
    good="contingency: {faults: 1}\n",
)
TAG = FAMILY.stop(
    "DG014",
    "yaml-tag",
    what="A value carries a YAML tag (`!name`).",
    why="Tags change the type of a value, in some programs by running code.",
    fix="Remove it; put a number in quotes to make it text.",
    bad="name: !!str x\n",
    good="name: x\n",
)
DUPLICATE_KEY = FAMILY.stop(
    "DG015",
    "duplicate-key",
    what="A key is given twice in one map.",
    why="Most YAML programs keep one of the two without a message, and not all of them keep the same one.",
    fix="Remove one of them, or rename it.",
    bad="contingency: {faults: 1, faults: 2}\n",
    good="contingency: {faults: 2}\n",
)
KEY_NOT_TEXT = FAMILY.stop(
    "DG016",
    "key-not-text",
    what="A key is not text.",
    why="Keys are names of fields and of elements; `1`, `true` and lists are not names.",
    fix="Write a name; put it in quotes where YAML would read a number.",
    bad="phases: {1: {}}\n",
    good="phases: {first: {}}\n",
)
WORD_READ_DIFFERENTLY = FAMILY.stop(
    "DG020",
    "ambiguous-word",
    what="A word that some programs read as true, false or null: on, off, yes, no, True, NULL ...",
    why=_SURPRISE,
    fix="Write true, false or null in small letters, or put the word in quotes.",
    bad="name: on\n",
    good='name: "on"\n',
)
NOT_DECIMAL = FAMILY.stop(
    "DG021",
    "not-decimal",
    what="A number in octal, hexadecimal or binary.",
    why=_SURPRISE,
    fix="Write it in decimal.",
    bad=f"variables:\n  speed: {{type: FLOAT, unit: m/s, identifier: 0x13B}}\nmodules:\n{DRIVER}{DISPLAY}",
    good=f"variables:\n  speed: {{type: FLOAT, unit: m/s, identifier: 315}}\nmodules:\n{DRIVER}{DISPLAY}",
)
BASE_60 = FAMILY.stop(
    "DG022",
    "base-60",
    what="Digits with colons, which some programs read as a number to the base 60.",
    why=_SURPRISE,
    fix="Write a plain number, or put it in quotes.",
    bad="contingency: {faults: 0:02}\n",
    good="contingency: {faults: 2}\n",
)
DATE = FAMILY.stop(
    "DG023",
    "date",
    what="A text that some programs read as a date.",
    why=_SURPRISE,
    fix="Put it in quotes.",
    bad="contingency: {faults: 2001-01-01}\n",
    good="contingency: {faults: 1}\n",
)
NOT_FINITE = FAMILY.stop(
    "DG024",
    "not-finite",
    what="A number that is infinite, or not a number (.inf, .nan).",
    why="No quantity of a spec is infinite; to set no bound, leave the field out.",
    fix="Write a finite number, or leave the field out.",
    bad="buses: {can0: {bitrate: 1000000, rate_per_h: .inf}}\n",
    good="buses: {can0: {bitrate: 1000000, rate_per_h: 0.001}}\n",
)
NOT_A_PLAIN_NUMBER = FAMILY.stop(
    "DG025",
    "odd-number",
    what="A number with '_', '+', a leading zero or a bare point.",
    why=_SURPRISE,
    fix="Write digits alone: 1000, 0.5, -3, 1e-5.",
    bad="buses: {can0: {bitrate: 1_000_000}}\n",
    good="buses: {can0: {bitrate: 1000000}}\n",
)
LONG_NUMBER = FAMILY.stop(
    "DG026",
    "long-number",
    what="A number of more than 40 characters, or with an exponent beyond 40.",
    why="Numbers are kept exact, and no quantity of a spec needs so many digits.",
    fix="Write fewer digits.",
    bad="buses: {can0: {bitrate: 1000000, rate_per_h: 1e-99}}\n",
    good="buses: {can0: {bitrate: 1000000, rate_per_h: 1e-9}}\n",
)
SPECIAL_KEY = FAMILY.stop(
    "DG027",
    "special-key",
    what="One of the special keys of YAML 1.1: `<<` (merge) or `=` (value).",
    why="Some programs merge another map here, others read a key of that name.",
    fix="Write out the map or the value that it stands for.",
    bad="contingency: {<<: {faults: 2}}\n",
    good="contingency: {faults: 2}\n",
)
BAD_COMMENT = FAMILY.error(
    "DG090",
    "bad-comment",
    what="A comment that begins with `dg:` is not an instruction that `heronry check` knows.",
    why="A misspelt instruction would be skipped without a message, and would have no effect.",
    fix="Write `# dg: ignore[DG240] reason`, or `# dg: error[DG240]` above the first line of the spec.",
    bad="contingency: {faults: 1}  # dg: ingore[DG240] later\n",
    good="contingency: {faults: 1}  # later\n",
)
NO_REASON = FAMILY.error(
    "DG091",
    "ignore-without-reason",
    what="A finding is ignored, and the comment does not say why.",
    why="A later reader of the spec cannot tell a considered exception from a warning that was merely silenced.",
    fix="Write the reason behind the bracket: `# dg: ignore[DG240] read by the ground station`.",
    bad="variables:\n  speed: {type: FLOAT}\n  spare: {type: FLOAT}  # dg: ignore[DG240]\n",
    good="variables:\n  speed: {type: FLOAT}\n  spare: {type: FLOAT}  # dg: ignore[DG240] reserved for the ground\n",
)
UNUSED_IGNORE = FAMILY.warning(
    "DG092",
    "unused-ignore",
    what="A comment ignores a finding that is not there.",
    why="The mistake was fixed, and the comment was forgotten: the comment would hide the next mistake.",
    fix="Remove the code from the comment, or the whole comment.",
    bad="variables:\n  speed: {type: FLOAT}  # dg: ignore[DG240] not read yet\n",
    good="variables:\n  speed: {type: FLOAT}\n",
)
UNKNOWN_CODE = FAMILY.error(
    "DG093",
    "unknown-code",
    what="A comment names a code that does not exist, or one that cannot be ignored or raised.",
    why="The comment has no effect. A finding that stops a spec from being loaded cannot be ignored.",
    fix="`heronry rules` lists the codes.",
    bad="contingency: {faults: 1}  # dg: ignore[DG999] later\n",
    good="contingency: {faults: 1}\n",
)
