"""Two specs as one file that a person reads: the elements of both as they were written, section by section.

The second file is edited first (new names, node-IDs, identifiers, features), the first one where features are added.
Then each section has the elements of the first vehicle and, below a line that names it, those of the second. Comments
above and beside elements stay; those above a section of the second file move into the section. What concerns the whole
file is written anew: name, manager, phases, contingency, groups of modules.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import yaml

from heronry_dg.findings import listed
from heronry_dg.model import Spec
from heronry_tools.analysis.combine.joining import BUS, MODULE, Joint
from heronry_tools.analysis.combine.renaming import rename
from heronry_tools.analysis.combine.spec_text import Document, Edits, fields

MADE_BY = "# Made by 'heronry combine' from "
_SECTIONS = ("buses", "pes", "devices", "variables", "gates", "modules", "functions", "plants")
_GROUPS = ("separate", "together", "common_cause")
_WIDTH = 120


@dataclass(frozen=True, slots=True)
class Half:
    """One of the two specs: its model and its text."""

    spec: Spec
    document: Document


def combined_text(first: Half, second: Half, joint: Joint) -> str:
    """Write the spec that two specs become; it loads, and means what `joint` decided."""
    ours = Half(first.spec, _labelled(first.document, joint, 0))
    theirs = Half(second.spec, _labelled(_edited(second, joint), joint, 1))
    return "".join(_parts(ours, theirs, joint))


def told(first: Spec, second: Spec, joint: Joint) -> list[str]:
    """Say in sentences what was decided, for the head of the file and for the user."""
    near, far = (", ".join(names) for names in joint.gateways)
    return [
        f"Over {joint.link}: {near} ({first.name}) and {far} ({joint.labels[1]}).",
        f"The manager is on {joint.manager.bus}.",
        *_told_of_data(first, second, joint),
        *(
            f"Renamed, with the prefix {joint.labels[1]}_: {kind} {', '.join(names)}."
            for kind, renames in joint.renames.items()
            if (names := [name for name, new in renames.items() if (kind, new) != (BUS, joint.link)])
        ),
        *(
            f"PE {joint.renamed('pe', pe)} has node-ID {node} now, and not {second.pes[pe].node_id}: set it on the PE."
            for pe, node in joint.node_ids.items()
        ),
        *(
            [f"A standard identifier less: {', '.join(joint.renamed('datum', name) for name in joint.freed)}."]
            if joint.freed
            else []
        ),
        *(
            f"The code of image {image} must learn the new names, where it names {', '.join(data)}."
            for image, data in _code_that_must_follow(second, joint)
        ),
    ]


def _told_of_data(first: Spec, second: Spec, joint: Joint) -> Iterator[str]:
    for giver, reader in ((first, second), (second, first)):
        crossing = [name for name in joint.shared if any(giver.producers(name)) and any(_readers(reader, name))]
        if crossing:
            yield f"{giver.name} gives {reader.name} {', '.join(crossing)}."


def _readers(spec: Spec, variable: str) -> Iterator[str]:
    for module in spec.modules.values():
        if any(leaf.variable == variable for mode in module.modes.values() for _, leaf in mode.leaves()):
            yield module.name


def _code_that_must_follow(second: Spec, joint: Joint) -> Iterator[tuple[str, list[str]]]:
    """Yield the images of the second spec whose modules read or give renamed data, with these data."""
    found: dict[str, dict[str, None]] = {}
    for module in second.modules.values():
        for mode in module.modes.values():
            for name in (*mode.gives, *(leaf.variable for _, leaf in mode.leaves())):
                if name in joint.renames["datum"]:
                    found.setdefault(module.image, {})[name] = None
    return ((image, list(data)) for image, data in found.items())


def _edited(half: Half, joint: Joint) -> Document:
    """Return the second spec with the names and numbers that it has in the combined one."""
    edits = Edits(half.document)
    rename(edits, joint.renames)
    for pe, node in joint.node_ids.items():
        _, value = fields(half.document.elements("pes")[pe][1])["node_id"]
        edits.replace(half.document.begin(value), half.document.end(value), str(node))
    for name in joint.freed:
        edits.drop_key(half.document.elements("variables")[name][1], "identifier")
    for name in joint.renames[MODULE]:
        body = half.document.elements("modules")[name][1]
        if "image" not in fields(body):
            edits.add_key(body, "image", name)
    return edits.applied()


def _labelled(document: Document, joint: Joint, number: int) -> Document:
    """Return a spec whose pinned modules require the feature of its vehicle, and whose PEs have it."""
    edits, label = Edits(document), joint.labels[number]
    if not joint.pinned[number]:
        return document
    for name in joint.pinned[number]:
        own = joint.renamed(MODULE, name) if number else name
        edits.add_to_list(document.elements("modules")[own][1], "requires", label)
    for _, pe in document.elements("pes").values():
        edits.add_to_list(pe, "features", label)
    return edits.applied()


def _parts(first: Half, second: Half, joint: Joint) -> Iterator[str]:
    ours, theirs = first.document, second.document
    yield from _head(first, second, joint)
    yield f"dg: 1\nname: {joint.name}\n"
    done = {"dg", "name"}
    for section in [*ours.sections(), *theirs.sections(), "manager"]:
        if section in done:
            continue
        done.add(section)
        lead = ours.lead(section) if section in ours.sections() else ""
        body = _section(section, first, second, joint)
        if body:
            yield (lead or "\n") + body


def _head(first: Half, second: Half, joint: Joint) -> Iterator[str]:
    halves = (first, second)
    made = f"{MADE_BY}{listed(f'{one.spec.name} ({one.spec.digest[:12]})' for one in halves)}."
    for sentence in (made, *told(first.spec, second.spec, joint)):
        yield from _wrapped(sentence if sentence.startswith("#") else f"# {sentence}")
    for half in halves:
        head = half.document.head().strip("\n")
        if head:
            yield f"#\n# ---- {half.spec.name} ----\n{head}\n"


def _wrapped(sentence: str) -> Iterator[str]:
    line = ""
    for word in sentence.split(" "):
        if line and len(line) + 1 + len(word) > _WIDTH:
            yield line + "\n"
            line = f"#   {word}"
        else:
            line = f"{line} {word}" if line else word
    yield line + "\n"


def _section(section: str, first: Half, second: Half, joint: Joint) -> str:
    """Return one section of the combined file, without the comments above its key; empty where it has no content."""
    match section:
        case "manager":
            return f"manager: {{bus: {joint.manager.bus}, without_manager: {joint.manager.without_manager}}}\n"
        case "contingency":
            return _contingency(first.spec, second.spec)
        case "mission_h":
            given = (one for one in (first, second) if section in one.document.sections())
            longest = max(given, key=lambda one: one.spec.mission_h or 0)
            return f"mission_h: {longest.document.written(longest.document.sections()['mission_h'][1])}\n"
        case "phases":
            chunks = (first, second)[joint.phases_of].document.chunks("phases")
            return "phases:\n" + "".join(chunks.values()) if chunks else ""
        case _ if section in _GROUPS:
            groups = [*_groups(first.document, section), *_groups(second.document, section)]
            return f"{section}:\n" + "".join(f"  - {group}\n" for group in groups) if groups else ""
        case _:
            return _elements(section, first, second, joint)


def _contingency(first: Spec, second: Spec) -> str:
    both = (first.contingency, second.contingency)
    faults = max(one.faults for one in both)
    phases = [one.phases for one in both if one.phases is not None]
    if len(phases) < len(both):
        return f"contingency: {{faults: {faults}}}\n"
    return f"contingency: {{faults: {faults}, phases: [{', '.join(dict.fromkeys((*phases[0], *phases[1])))}]}}\n"


def _groups(document: Document, section: str) -> Sequence[str]:
    node = document.sections()[section][1] if section in document.sections() else None
    return [document.written(one) for one in node.value] if isinstance(node, yaml.SequenceNode) else []


def _elements(section: str, first: Half, second: Half, joint: Joint) -> str:
    ours, theirs = first.document.chunks(section), second.document.chunks(section)
    if section == "variables":
        theirs = {name: chunk for name, chunk in theirs.items() if name not in joint.shared}
    if section == "buses":
        theirs = {name: chunk for name, chunk in theirs.items() if name != joint.link}
    if not ours and not theirs:
        return ""
    lines = [f"{section}:\n", *ours.values()]
    if theirs:
        lead = second.document.lead(section) if section in second.document.sections() else ""
        lines.append(f"  # ---- {joint.labels[1]} ----\n")
        lines += [f"  {line}\n" for line in lead.splitlines() if line.strip()]
        lines += theirs.values()
    return "".join(lines)
