"""The words of the field: a retired word in prose is an error, which names the term to use instead.

Prose is what a person reads: comments, docstrings, texts of more than one word, names of functions and classes,
Markdown outside of code, comments of scenarios and specs, and all of Makefile, scripts and pyproject.toml. Interfaces
keep their spelling (JSON keys, event kinds, scenario verbs, options, state names; docs/glossary.md lists them), so
these are no prose: what stands in backticks or quotes, is joined by an underscore, a dot or a colon, or is in capitals;
options; and the verb before an element (`deaf pe:nav`).

Besides: no file of the product is too long, and the map of the repository stays one page.
"""

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
CHECKED = (
    *(
        "Makefile",
        "pyproject.toml",
        ".ci/run",
        "README.md",
        "ARCHITECTURE.md",
        "CHANGELOG.md",
        "docs",
        "dbc",
        "dg_specs",
    ),
    *("pe_agent", "manager", "tests", "tools", "tools/make-wheelhouse", "tools/mutate", "tools/prepare-venv"),
    *("tools/try-desk-page", "tools/with-vcan"),
)
QUOTING = {  # files that have to quote retired words
    "tests/lab/tests/test_retired_words.py": "the words themselves",
    "tests/lab/tests/test_words.py": "sentences of earlier golden traces",
    "dg_specs/big_blue.dg.yaml": "a comment; the digest of a spec covers its comments, and flights are known by it",
    "dg_specs/examples/feedback.dg.yaml": "likewise",
    "tests/scenarios/ground_autopilot.dg.yaml": "likewise",
}
PRODUCT = ("dbc", "dg_specs", "pe_agent", "manager", "tools")
MOST_LINES = 500  # of a file of the product
MOST_BYTES_OF_THE_MAP = 8192

RETIRED = {  # by the pattern of a word; the space in a phrase may be the end of a line
    r"reign\w*": "mastership, active manager",
    r"count(?:s|ed|ing)? on": "available",
    r"(?:dis)?obe(?:y|dien)\w*": "accept, execute; command acceptance",
    r"deaf\w*": "receive failed",
    r"mute[ds]?": "transmit failed",
    r"vouch\w*": "inherited from the previous manager",
    r"(?:take[ns]?|took|taking) back": "discount (losses), withdraw (frames)",
    r"at leisure": "in the background",
    r"foresight|thinker\w*|th(?:inks?|inking|ought) ahead": "pre-planning, pre-planner",
    r"judg\w+": "verifier, verify; oracle (in the simulator); assess",
    r"strikes?|striking|struck(?! out)": "fault, inject",
    r"(?:an|the|each|every) act": "fault",
    r"drill\w*": "conformance test",
    r"technician\w*": "diagnostic client",
    r"bench(?:es)?": "plant; benchmark",
    r"news": "link status events",
    r"bef(?:all\w*|ell)": "link status events; happen to",
    r"who(?:m|so)?ever|whom": "the name of the thing",
}
KEPT = (  # names of CANopen objects, an interface too; and the first line of a spec, which the tutorial quotes
    *("Manager that is obeyed", "Frames not understood or not obeyed"),
    "what its own effect is judged to be",
)
_RETIRED = re.compile(
    r"\b(?:%s)(?![\w-])" % "|".join(f"({word})" for word in RETIRED).replace(" ", r"[\s#]+"),  # noqa: UP031
    re.IGNORECASE,
)
_INTERFACE = re.compile(
    r"""`[^`]{1,200}` | "[^"\n]{1,60}" | (?<!\w)'[^'\n]{1,60}'(?!\w)   # quoted
    | \{[^{}\n]*\}                                                     # a place that a program fills in
    | --[\w-]+ | \b\w*_\w+ | \b\w+(?:\\?[.:/]\w+)+ | \b[A-Z][A-Z]+\b   # option, name, path, state
    | \b\w+[ ](?=(?:pe|bus|module|device):\w)                          # verb of a scenario
    """,
    re.VERBOSE,
)
_TEXT = (tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING))  # the latter from Python 3.12 on


def blank(text: str) -> str:
    """Replace all but the ends of lines by spaces."""
    return re.sub(r"[^\n]", " ", text)


def prose_of_python(source: str) -> str:
    """Give a source in which all but comments and texts of more than one word is blank, in the same places."""
    starts = [0]
    for line in io.StringIO(source):
        starts.append(starts[-1] + len(line))
    parts, end = [], 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            text = token.string
        elif token.type in _TEXT and re.search(r"\S\s+\S", token.string):
            text = re.sub(r"""^\w*("{3}|'{3}|"|')|("{3}|'{3}|"|')$""", lambda quote: blank(quote[0]), token.string)
        else:
            continue
        start = starts[token.start[0] - 1] + token.start[1]
        parts += [blank(source[end:start]), text]
        end = start + len(token.string)
    return "".join([*parts, blank(source[end:])])


def prose_of_markdown(source: str) -> str:
    """Give a page in which blocks of code and the targets of links are blank."""
    return re.sub(r"^```.*?^```|\]\([^)]*\)", lambda code: blank(code[0]), source, flags=re.DOTALL | re.MULTILINE)


def prose_of_comments(source: str) -> str:
    """Give a scenario or a spec in which all but comments is blank."""
    return re.sub(r"^((?:[^#\n]*[^#\s])?\s*)#|^[^#\n]+$", lambda line: blank(line[0]), source, flags=re.MULTILINE)


PROSE = {".md": prose_of_markdown, ".scenario": prose_of_comments, ".yaml": prose_of_comments}


def names(source: str) -> Iterator[tuple[int, str]]:
    """Give the names of functions and classes as words, each with its line."""
    for found in re.finditer(r"^ *(?:async )?(?:def|class) (\w+)", source, re.MULTILINE):
        yield source.count("\n", 0, found.start(1)) + 1, re.sub(r"_|(?<=[a-z])(?=[A-Z])", " ", found[1])


def retired_in(prose: str) -> Iterator[tuple[int, str]]:
    """Give each retired word of a prose: its line, and what is wrong with it."""
    for kept in KEPT:
        prose = prose.replace(kept, blank(kept))
    plain = _INTERFACE.sub(lambda name: blank(name[0]), prose)
    for found in _RETIRED.finditer(plain):
        term = list(RETIRED.values())[(found.lastindex or 1) - 1]
        yield plain.count("\n", 0, found.start()) + 1, f"'{' '.join(found[0].replace('#', ' ').split())}': write {term}"


def findings(file: Path) -> Iterator[str]:
    """Give the retired words of a file, as FILE:LINE: and a sentence."""
    source = file.read_text(encoding="utf-8", errors="replace")
    is_python = file.suffix == ".py" or source.startswith("#!/usr/bin/env python3")
    found = [(line, text) for line, name in names(source) for _, text in retired_in(name)] if is_python else []
    if _RETIRED.search(source):
        prose = prose_of_python if is_python else PROSE.get(file.suffix, str)
        found += retired_in(prose(source))
    for line, text in sorted(found):
        yield f"{file.relative_to(ROOT)}:{line}: {text}"


def files(*places: str) -> Iterator[Path]:
    """Give the files of these places that hold prose."""
    for place in map(ROOT.joinpath, places):
        if place.is_dir():
            yield from (
                file for file in sorted(place.rglob("*")) if file.suffix in (".py", ".md", ".scenario", ".yaml")
            )
        else:
            yield place


def test_prose_has_no_retired_word() -> None:
    quoting = {ROOT / name for name in QUOTING}
    found = [finding for file in files(*CHECKED) if file not in quoting for finding in findings(file)]
    assert not found, "\n".join(["retired words (docs/glossary.md has the vocabulary):", *found])


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        (
            "a.py",
            '"""A PE\n    that obeys."""\nx = "judge"  # nothing counts\n# on it\n',
            ["2: 'obeys'", "3: 'counts on'"],
        ),
        ("a.py", 'f"{reign} of `deaf`, \'deaf\', DEAF, --deaf, is_deaf, sim.deaf"\n"deaf pe:nav at 2.0"\n', []),
        ("a.py", 'def test_it_obeys() -> None:\n    """Nothing."""\n', ["1: 'obeys'"]),
        ("a.md", "The [judge](judge.md)\n```\njudge\n```\nis `judge`\n", ["1: 'judge'"]),
        ("a.scenario", "1.0 deaf nav # struck\n# the news\nspec news\n", ["1: 'struck'", "2: 'news'"]),
        ("Makefile", "all:  # a drill\n\techo 'thinks ahead'\n", ["1: 'drill'"]),
    ],
)
def test_a_retired_word_is_found_in_prose_alone(
    name: str, text: str, found: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert [finding.partition(":")[2].partition(": write")[0] for finding in findings(tmp_path / name)] == found


def test_no_file_of_the_product_is_too_long() -> None:
    lengths = {file: file.read_text(encoding="utf-8").count("\n") for file in files(*PRODUCT) if file.suffix == ".py"}
    too_long = [f"{file.relative_to(ROOT)}: {lines} lines" for file, lines in lengths.items() if lines > MOST_LINES]
    assert not too_long, f"divide what has more than {MOST_LINES} lines: {', '.join(too_long)}"


def test_the_map_is_one_page() -> None:
    assert (ROOT / "ARCHITECTURE.md").stat().st_size <= MOST_BYTES_OF_THE_MAP
