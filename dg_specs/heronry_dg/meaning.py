"""The digest of a spec: that of what the spec means, not of how its file is written.

Tables, contingencies, plans, journals and recordings name their spec by this digest. Two files have the same digest if
they resolve to the same model (`model.Spec`), apart from what only analysis reads. So these do not count:

- comments, blank lines, line breaks, quotes, the order of keys, and a key that is given with its default;
- notation: `0.8` or `0.80`, `1MiB` or `1024KiB`, `altitude` or `altitude@<=3` of three versions;
- keys that are declared with `analysis_only`; and with `repeats`, since other fields tell what they do.

The order of elements counts, also that of the outputs in `gives`: the indices in slices and EMCYs are positions.

The canonical form is JSON: a record is an object with its fields sorted by name, without those that have their
default, so a key that a later version adds changes no digest of a spec without that key. A map of elements is an object
in the order of the spec; a map by phase, whose order has no meaning, is sorted, and `""` stands for all other phases; a
fraction is `n/d`.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, replace
from fractions import Fraction
from functools import cache
from hashlib import sha256
from typing import Any

from heronry_dg.keys import keys_of
from heronry_dg.model import Spec


def with_digest(spec: Spec) -> Spec:
    """Return a spec with its digest, in the place of the one that it has."""
    return replace(spec, digest=sha256(canonical_form(spec).encode()).hexdigest())


def canonical_form(spec: Spec) -> str:
    """Return the canonical form of a spec, of which the digest is made, as one line of JSON."""
    content = {key: value for key, value in _record(spec).items() if key != "digest"}
    return json.dumps(["dg 1", content], separators=(",", ":"), default=_plain)


def _plain(value: Any) -> Any:
    """Return what JSON can write in the place of a record, a set or a fraction."""
    if isinstance(value, frozenset):
        return sorted(value)
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    return _record(value)


def _record(one: Any) -> dict[str, Any]:
    told: dict[str, Any] = {"": type(one).__name__}
    for name, default, in_any_order in _meaningful(type(one)):
        value = getattr(one, name)
        if value != default:
            told[name] = _sorted(value) if in_any_order else value
    return told


def _sorted(by_phase: Mapping[str | None, Any]) -> dict[str, Any]:
    return dict(sorted((phase or "", value) for phase, value in by_phase.items()))


def _of_kind(kind: Any) -> tuple[tuple[str, Any, bool], ...]:
    """List the fields of a record that count, sorted by name: name, default, and whether it is a map in any order."""
    keys = keys_of(kind)
    untold = {one.field for one in keys if one.key.analysis_only or one.key.repeats}
    in_any_order = {one.field for one in keys if one.reading.in_any_order}
    return tuple(
        (one.name, _default(one), one.name in in_any_order)
        for one in sorted(fields(kind), key=lambda one: one.name)
        if one.name not in untold
    )


_meaningful: Callable[[Any], tuple[tuple[str, Any, bool], ...]] = cache(_of_kind)


def _default(one: Field[Any]) -> Any:
    return one.default if one.default_factory is MISSING else one.default_factory()
