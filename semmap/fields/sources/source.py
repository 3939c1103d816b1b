"""What a source is (reMap, section 3.1.1): from a percept to any number of maps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points
from typing import Any, Protocol

from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary

__all__ = ["GROUP", "Source", "discovered", "make_source"]

GROUP = "semmap.sources"
"""The group of entry points under which packages offer sources: `name = "module:Class"`."""


class Source(Protocol):
    """Makes maps of a percept: as many as it likes, other ones each time.

    Made by ``Class(vocabulary, **options)``.
    """

    def __call__(self, percept: Any) -> Iterable[RepresentationMap]: ...


def discovered() -> Mapping[str, str]:
    """The sources that are installed: by name, where each comes from."""
    return {point.name: point.value for point in entry_points(group=GROUP)}


def make_source(name: str, vocabulary: Vocabulary, **options: Any) -> Source:
    """A source by the name under which a package offers it.

    Raises
    ------
    LookupError
        Nobody offers such a source.
    """
    for point in entry_points(group=GROUP, name=name):
        made: Source = point.load()(vocabulary, **options)
        return made
    known = ", ".join(sorted(discovered())) or "none"
    raise LookupError(f"there is no source {name}: {known} are installed")
