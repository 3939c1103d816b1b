"""What a service runs: its sources and how often it keeps its state, from YAML and options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class SourceSettings:
    """A source and its percepts."""

    name: str  # of the running source
    source: str  # the installed source that it is
    percepts: str | Mapping[str, Any] = "socket"  # as `make_feed` takes them
    rate: float = 20.0  # the most updates per second
    # seconds without a percept after which what it provides is unknown; 0 for never
    timeout: float = 30.0
    options: Mapping[str, Any] = field(default_factory=dict)  # of the source


@dataclass(frozen=True)
class ServiceSettings:
    """The settings of a service."""

    sources: tuple[SourceSettings, ...] = ()  # that run from the beginning
    save_every: float = 10.0  # seconds between saves of the voxels of the map
    keep_every: float = 1.0  # least seconds between the updates of a source that are kept
    keep_for: float = 3600.0  # seconds for which these are kept


def read_settings(
    path: Path | None = None, sources: Sequence[str] = (), rates: Sequence[str] = ()
) -> ServiceSettings:
    """Return the settings of a YAML file, with those of options.

    `sources` are NAME=PERCEPTS or NAME:SOURCE=PERCEPTS, `rates` NAME=UPDATES PER SECOND. Raises
    ValueError: a setting is unknown or wrong; with its name.
    """
    given = _yaml(path)
    known = given.pop("sources", None) or {}
    if not isinstance(known, Mapping):
        raise ValueError(f"{path}: sources is not a mapping: write NAME: and its settings below")
    found = {str(name): _source(str(name), each or {}) for name, each in known.items()}
    for each in sources:
        name, _, percepts = each.partition("=")
        name, _, kind = name.partition(":")
        if not name or not percepts:
            raise ValueError(f"--source {each}: write NAME=PERCEPTS, such as gaze=socket")
        found[name] = SourceSettings(name, kind or name, percepts)
    for each in rates:
        name, _, rate = each.partition("=")
        if name not in found:
            raise ValueError(f"--rate {each}: there is no source {name} in this command")
        found[name] = replace(found[name], rate=_number(rate, f"--rate {each}"))
    numbers = {name: _number(value, f"{path}: {name}") for name, value in given.items()}
    unknown = numbers.keys() - {"save_every", "keep_every", "keep_for"}
    if unknown:
        raise ValueError(
            f"{path}: {min(unknown)} is unknown: settings are sources, save_every, keep_every, "
            "keep_for"
        )
    return ServiceSettings(tuple(found.values()), **numbers)


def _yaml(path: Path | None) -> dict[str, Any]:
    if path is None:
        return {}
    import yaml

    try:
        given = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"{path} is not readable as YAML: {error}") from None
    if given is not None and not isinstance(given, dict):
        raise ValueError(f"{path}: write a mapping, such as sources:")
    return given or {}


def _source(name: str, given: Any) -> SourceSettings:
    if not isinstance(given, Mapping):
        raise ValueError(f"sources.{name} is not a mapping: write source, percepts, rate, options")
    unknown = given.keys() - {"source", "percepts", "rate", "timeout", "options"}
    if unknown:
        raise ValueError(
            f"sources.{name}.{min(unknown)} is unknown: settings are source, percepts, rate, "
            "timeout, options"
        )
    rates = {
        key: _number(given[key], f"sources.{name}.{key}")
        for key in ("rate", "timeout")
        if key in given
    }
    return SourceSettings(
        name,
        str(given.get("source", name)),
        given.get("percepts", "socket"),
        options=dict(given.get("options") or {}),
        **rates,
    )


def _number(given: Any, name: str) -> float:
    try:
        number = float(given)
    except (TypeError, ValueError):
        number = -1.0
    if not 0 <= number < float("inf"):
        raise ValueError(f"{name} is {given!r}: give a number of at least 0")
    return number
