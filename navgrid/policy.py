"""Which entity goes on which layer: a small readable file of rules (Deeken et al., section 4.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from navgrid.scene import Thing
from semmap.yaml_file import parse_yaml, read_text

__all__ = ["FLOOR", "NONE", "Layer", "Policy", "PolicyError", "Rule"]

NONE, FLOOR = "none", "floor"
"""Layers that are no layers: what is not in the way, and what robots drive on."""

KINDS = ("room", "object", "region", "connector", "agent")


class PolicyError(ValueError):
    """A policy file that cannot be used: names the file, the element and the mend."""


@dataclass(frozen=True)
class Layer:
    """A layer of each part's costmap; `padding` metres go onto its inflation."""

    name: str
    padding: float = 0.0


@dataclass(frozen=True)
class Rule:
    """What an entity has to be, all of it, to go on a layer; empty parts ask nothing."""

    layer: str
    kind: str | None = None
    types: tuple[str, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    state: str | None = None

    def fits(self, thing: Thing) -> bool:
        """Whether it decides about this entity."""
        return (
            (self.kind is None or self.kind == thing.kind)
            and (not self.types or not set(self.types).isdisjoint(thing.types))
            and all(thing.properties.get(key) == value for key, value in self.properties)
            and (self.state is None or self.state == thing.state)
        )


@dataclass(frozen=True)
class Policy:
    """Layers in their order, and the rules, of which the first that fits decides."""

    layers: tuple[Layer, ...]
    rules: tuple[Rule, ...]

    @staticmethod
    @cache
    def default() -> Policy:
        """The policy that comes with navgrid, ``policy.yaml`` beside this file."""
        file = resources.files("navgrid") / "policy.yaml"
        return Policy.parse(file.read_text("utf-8"), "navgrid's policy.yaml")

    @classmethod
    def read(cls, path: Path | str) -> Policy:
        """The policy of a file.

        Raises
        ------
        PolicyError
            A file that is not there or says what no policy says.
        """
        return cls.parse(read_text(path, "a policy file", PolicyError), str(path))

    @classmethod
    def parse(cls, said: str, file: str) -> Policy:
        """The policy of YAML text; `file` is what errors call it."""
        document = parse_yaml(said, file, PolicyError)
        parts = _mapping(document, file, "the file", {"layers", "rules"})
        layers = tuple(
            _layer(str(name), value, file)
            for name, value in _mapping(parts.get("layers"), file, "layers").items()
        )
        rules = parts.get("rules")
        if not isinstance(rules, list) or not layers:
            raise PolicyError(f"{file}: needs layers, and rules as a list")
        known = {layer.name for layer in layers} | {NONE, FLOOR}
        return cls(layers, tuple(_rule(r, i, known, file) for i, r in enumerate(rules, 1)))

    def layer_of(self, thing: Thing) -> str:
        """The layer on which an entity goes; `NONE` where no rule fits."""
        return next((rule.layer for rule in self.rules if rule.fits(thing)), NONE)


def _mapping(
    value: object, file: str, element: str, keys: set[str] | None = None
) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise PolicyError(f"{file}: {element}: give key: value, not {value!r}")
    unknown = set(value) - keys if keys is not None else set()
    if unknown:
        raise PolicyError(
            f"{file}: {element}: knows no {sorted(map(str, unknown))[0]}; "
            f"it takes {', '.join(sorted(keys or ()))}"
        )
    return value


def _layer(name: str, value: object, file: str) -> Layer:
    said = _mapping({} if value is None else value, file, f"layer {name}", {"padding"})
    padding = said.get("padding", 0.0)
    if isinstance(padding, bool) or not isinstance(padding, int | float):
        raise PolicyError(f"{file}: layer {name}: padding is metres, not {padding!r}")
    if not (math.isfinite(padding) and padding >= 0) or name in (NONE, FLOOR):
        raise PolicyError(
            f"{file}: layer {name}: give padding of 0 or more metres, and a name but none and floor"
        )
    return Layer(name, float(padding))


def _rule(value: object, number: int, known: set[str], file: str) -> Rule:
    element = f"rule {number}"
    said = _mapping(value, file, element, {"kind", "type", "properties", "state", "layer"})
    layer = said.get("layer")
    if not isinstance(layer, str) or layer not in known:
        raise PolicyError(f"{file}: {element}: its layer is one of {', '.join(sorted(known))}")
    kind = said.get("kind")
    if kind is not None and kind not in KINDS:
        raise PolicyError(f"{file}: {element}: its kind is one of {', '.join(KINDS)}")
    types = said.get("type", [])
    types = [types] if isinstance(types, str) else types
    if not isinstance(types, list) or not all(isinstance(t, str) for t in types):
        raise PolicyError(f"{file}: {element}: type is a name or a list of names")
    properties = _mapping(said.get("properties", {}), file, f"{element}, properties")
    state = said.get("state")
    if state not in (None, "open", "closed", "locked"):
        raise PolicyError(f"{file}: {element}: a state is open, closed or locked")
    return Rule(layer, kind, tuple(types), tuple(properties.items()), state)
