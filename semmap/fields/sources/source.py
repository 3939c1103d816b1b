"""Sources: plug-ins that make any number of maps from a percept (reMap, section 3.1.1)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points
from inspect import Parameter, signature
from types import MappingProxyType
from typing import Any, Protocol

from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.sources.percepts import Gaze, People, RobotState, Segmentation, Zones

GROUP = "semmap.sources"
"""The group of entry points for sources in packages: `name = "module:Class"`."""


KEYS: Mapping[type, str] = {
    Gaze: "poses",
    People: "people",
    RobotState: "pose",
    Segmentation: "depth and labels",
    Zones: "zones",
}
"""By what percepts of a kind are known where they are JSON."""


class Source(Protocol):
    """Makes maps from a percept. Constructed by ``Class(vocabulary, **options)``.

    It may have an attribute `provides`, the names of the properties that it states. Where a percept
    makes no map of one of them, a query answers that there is none; without a source that provides
    a property, a query on it is an error. `takes` may be the class of its percepts.
    """

    def __call__(self, percept: Any) -> Iterable[RepresentationMap]:
        """Return the maps of a percept; their number may differ each time."""
        ...


def check_percept(name: str, source: Source, percept: Any) -> None:
    """Raise ValueError for a percept of another kind than a source takes."""
    takes = getattr(source, "takes", None)
    if takes is not None and not isinstance(percept, takes):
        given = KEYS.get(type(percept), type(percept).__name__)
        raise ValueError(
            f"the source {name} takes percepts with {KEYS.get(takes, takes.__name__)}, not with "
            f"{given}: send them to a source that takes them (docs/fields.md)"
        )


def installed_sources() -> Mapping[str, str]:
    """Return the module and class of each installed source, by name."""
    return {point.name: point.value for point in entry_points(group=GROUP)}


def make_source(
    name: str,
    vocabulary: Vocabulary,
    offered: Mapping[str, Any] = MappingProxyType({}),
    /,
    **options: Any,
) -> Source:
    """Return a new source of an installed package; LookupError if none has it.

    `offered` are passed if the source has a parameter of their name, `options` anyway.
    """
    for point in entry_points(group=GROUP, name=name):
        kind = point.load()
        parameters = signature(kind).parameters
        any_name = any(each.kind is Parameter.VAR_KEYWORD for each in parameters.values())
        taken = {each: offered[each] for each in offered if any_name or each in parameters}
        made: Source = kind(vocabulary, **{**taken, **options})
        return made
    known = ", ".join(sorted(installed_sources())) or "none"
    raise LookupError(f"there is no source {name}; installed sources: {known}")
