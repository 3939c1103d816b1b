"""The forms of the values in a bundle, checked before anything is used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple
from uuid import UUID

from semmap.finite_number import is_finite_number
from semmap.limits import NAME_CHARACTERS
from semmap.manipulation.error import ManipulationError

LARGEST = 1e9
"""Of a number in a bundle: metres, radians, shares and outcomes are smaller."""


class _Form(NamedTuple):
    """A form of values in words, and a test for it."""

    words: str
    holds: Callable[[Any], bool]


def _is_text(value: Any) -> bool:
    try:
        return isinstance(value, str) and b"\0" not in value.encode()
    except UnicodeEncodeError:  # half of a pair of surrogates
        return False


def _is_name(value: Any) -> bool:
    return _is_text(value) and 0 < len(value) <= NAME_CHARACTERS.value


def _is_key(value: Any) -> bool:
    try:
        UUID(value)
    except (ValueError, TypeError, AttributeError):
        return False
    return True


def _list(form: _Form) -> _Form:
    return _Form(
        f"a list, each {form.words}",
        lambda value: isinstance(value, list) and all(map(form.holds, value)),
    )


def _by_name(form: _Form) -> _Form:
    return _Form(
        f"names, each with {form.words}",
        lambda value: (
            isinstance(value, dict)
            and all(map(_is_name, value))
            and all(map(form.holds, value.values()))
        ),
    )


NAME = _Form(f"a name of 1 to {NAME_CHARACTERS.value:g} characters", _is_name)
TEXT = _Form("a text", _is_text)
NUMBER = _Form(
    f"a number from {-LARGEST:g} to {LARGEST:g}",
    lambda value: is_finite_number(value) and abs(value) <= LARGEST,
)
COUNT = _Form(
    f"a count up to {LARGEST:g}",
    lambda value: isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= LARGEST,
)
KEY = _Form("a UUID", _is_key)
NUMBERS = _list(NUMBER)
LIMITS = _list(_Form(f"{NUMBER.words} or null", lambda value: value is None or NUMBER.holds(value)))

REQUIRED: dict[str, dict[str, _Form]] = {
    "gripper": {"name": NAME, "form": NAME, "opening": NUMBER, "depth": NUMBER},
    "object": {"key": NAME},
    "action": {
        "key": KEY,
        "kind": NAME,
        "object": NAME,
        "gripper": NAME,
        "quality": NUMBER,
        "attempts": COUNT,
        "successes": COUNT,
    },
}
OPTIONAL: dict[str, dict[str, _Form]] = {
    "gripper": {"force": NUMBER, "urdf": TEXT, "joints": _by_name(LIMITS)},
    "object": {
        "name": NAME,
        "type": NAME,
        "functions": _list(NAME),
        "shape": NAME,
        "size": NUMBERS,
        "shape_pose": NUMBERS,
        "inliers": NUMBER,
        "meshes": _list(NAME),
    },
    "action": {
        "pose": NUMBERS,
        "pre_pose": NUMBERS,
        "post_pose": NUMBERS,
        "motion": NUMBERS,
        "approach": NAME,
        "family": NAME,
        "width": NUMBER,
        "posture": _by_name(NUMBER),
        "pre_posture": _by_name(NUMBER),
        "replaced_by": KEY,
        "shift": NUMBERS,
        "steps": _list(KEY),
    },
}
"""The values of each kind of entry; optional ones may be null."""


def check_entry(kind: str, entry: Mapping[str, Any]) -> None:
    """Check the values of an entry: ManipulationError where one is missing or of another form."""
    if kind not in REQUIRED:
        raise ManipulationError(f"{kind!r} is not an entry: {', '.join(REQUIRED)} are")
    for name, form in REQUIRED[kind].items():
        if name not in entry:
            raise ManipulationError(f"the {kind} has no {name}: give {form.words}")
    for name, form in (REQUIRED[kind] | OPTIONAL[kind]).items():
        value = entry.get(name)
        if not (form.holds(value) or (value is None and name in OPTIONAL[kind])):
            raise ManipulationError(
                f"{name} of the {kind} is {str(value)[:60]!r}: give {form.words}"
            )
