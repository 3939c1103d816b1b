"""What a service runs: its sources and how often it keeps its state, from YAML and options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from semmap.yaml_file import parse_yaml, read_text

_NUMBERS = ("save_every", "keep_every", "keep_for", "rate", "timeout")


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
    given: Any = {}
    if path is not None:
        text = read_text(path, "a file of settings", ValueError)
        given = parse_yaml(text, str(path), ValueError) or {}
    settings = _checked(given, f"{path}: ", ("sources", "save_every", "keep_every", "keep_for"))
    known = settings.pop("sources", None) or {}
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
    return ServiceSettings(tuple(found.values()), **settings)


def _source(name: str, given: Any) -> SourceSettings:
    known = ("source", "percepts", "rate", "timeout", "options")
    found = {"source": name, **_checked(given, f"sources.{name}.", known)}
    options = found.get("options") or {}
    if not isinstance(options, Mapping):
        raise ValueError(f"sources.{name}.options is {options!r}: write a mapping")
    found["source"], found["options"] = str(found["source"]), dict(options)
    return SourceSettings(name, **found)


def _checked(given: Any, where: str, known: Sequence[str]) -> dict[str, Any]:
    """Return a mapping of known settings, those of `_NUMBERS` as numbers."""
    if not isinstance(given, Mapping):
        raise ValueError(f"{where.rstrip('.: ')}: write a mapping of {', '.join(known)}")
    for name in given.keys() - known:
        raise ValueError(f"{where}{name} is unknown: settings are {', '.join(known)}")
    return {
        name: _number(value, where + name) if name in _NUMBERS else value
        for name, value in given.items()
    }


def _number(given: Any, name: str) -> float:
    try:
        number = float(given)
    except (TypeError, ValueError, OverflowError):
        number = -1.0
    if not 0 <= number < float("inf"):
        raise ValueError(f"{name} is {given!r}: give a number of at least 0")
    return number
