"""Which entity, and which field, goes on which layer: a YAML file of rules (Deeken et al., 4.2).

Why: docs/decisions/the_checks_of_yaml_files_stay_our_own.md
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, get_args

from semmap.error import Error
from semmap.finite_number import is_finite_number
from semmap.query.storey_scene import EntityKind, SceneEntity
from semmap.yaml_file import parse_yaml, read_text

NONE, FLOOR, SOCIAL = "none", "floor", "social"
"""Names that are not layers: for what is not an obstacle, for what is driven on, and for fields
whose values are costs below those of obstacles."""

FIXED = "room_geometry"
"""The layer for undrivable floor; defaults to the policy's first layer."""

KINDS: tuple[str, ...] = get_args(EntityKind)
STATES = ("open", "closed", "locked")


class PolicyError(Error, ValueError):
    """A policy file is invalid; the message names the file, the element and how to fix it."""


@dataclass(frozen=True)
class Layer:
    """A layer of each part's costmap; the padding, metres, is added to the part's radii."""

    name: str
    padding: float = 0.0


@dataclass(frozen=True)
class PolicyRule:
    """The conditions under which an entity goes on a layer, `NONE` or `FLOOR`; all have to hold.

    One of `types` is the entity's type or a supertype of it; it has all the `properties`, (name,
    value). The state, "open", "closed" or "locked", is that of a connector, or of the
    door of a leaf. Empty or None: any.
    """

    layer: str
    kind: str | None = None
    types: tuple[str, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    state: str | None = None

    def applies_to(self, entity: SceneEntity) -> bool:
        """Return True if an entity meets all conditions."""
        return (
            (self.kind is None or self.kind == entity.kind)
            and (not self.types or not set(self.types).isdisjoint(entity.types))
            and all(entity.properties.get(key) == value for key, value in self.properties)
            and (self.state is None or self.state == entity.state)
        )


@dataclass(frozen=True)
class FieldRule:
    """The layer, or `NONE`, `FLOOR`, `SOCIAL`, of fields by property, such as ``containsPerson``.

    `kept`: seconds for which the answer of a query that was kept counts; by default none does.
    """

    properties: tuple[str, ...]
    layer: str
    kept: float = 0.0


@dataclass(frozen=True)
class Policy:
    r"""The layers of a costmap, and the rules that sort entities and fields to them.

    Attributes
    ----------
    layers : tuple of Layer
        In the order of pictures.
    rules : tuple of PolicyRule
        The first that applies to an entity decides.
    fields : tuple of FieldRule
        The first that names the property of a field decides.

    Examples
    --------
    >>> policy = Policy.parse("layers: {cups: {padding: 0.1}}\nrules: [{type: cup, layer: cups}]")
    >>> policy.layer_of(SceneEntity(1, "mug1", "object", ("mug", "cup", "object")))
    'cups'
    >>> policy.layer_of(SceneEntity(2, "table7", "object", ("table", "object")))
    'none'
    """

    layers: tuple[Layer, ...]
    rules: tuple[PolicyRule, ...]
    fields: tuple[FieldRule, ...] = ()

    @staticmethod
    @cache
    def default() -> Policy:
        """Return the policy that comes with navgrid, ``navgrid/policy.yaml``."""
        file = resources.files("navgrid") / "policy.yaml"
        return Policy.parse(file.read_text("utf-8"), "navgrid's policy.yaml")

    @classmethod
    def read(cls, path: Path | str) -> Policy:
        """Return the policy of a file; `PolicyError` if it cannot be read, or is not a policy."""
        return cls.parse(read_text(path, "a policy file", PolicyError), str(path))

    @classmethod
    def parse(cls, text: str, file: str = "policy") -> Policy:
        """Return the policy of a YAML text; `PolicyError`, which names the file, if it is none."""
        document = _mapping(
            parse_yaml(text, file, PolicyError), file, "document", {"layers", "rules", "fields"}
        )
        layers = tuple(
            _layer(str(name), value, file)
            for name, value in _mapping(document.get("layers"), file, "layers").items()
        )
        if not layers:
            raise PolicyError(f"{file}: layers: is empty; give one or more")
        rules: Any = document.get("rules")
        fields = document.get("fields", [])
        for name, value in (("rules", rules), ("fields", fields)):
            if not isinstance(value, list):
                raise PolicyError(f"{file}: {name}: is {value!r}; give a list")
        names = {layer.name for layer in layers} | {NONE, FLOOR}
        return cls(
            layers,
            tuple(_rule(rule, i, names, file) for i, rule in enumerate(rules, 1)),
            tuple(_field_rule(rule, i, names | {SOCIAL}, file) for i, rule in enumerate(fields, 1)),
        )

    @property
    def fixed_layer(self) -> str:
        """The name of the layer for floors and rooms where a robot does not drive on them."""
        names = [layer.name for layer in self.layers]
        return FIXED if FIXED in names else names[0]

    def layer_of(self, entity: SceneEntity) -> str:
        """Return the name of an entity's layer; `NONE` if no rule applies."""
        return next((rule.layer for rule in self.rules if rule.applies_to(entity)), NONE)

    def layer_of_field(self, property: str) -> str | None:
        """Return the name of the layer of the fields of a property; None if no rule names it."""
        return next((rule.layer for rule in self.fields if property in rule.properties), None)

    def keeps(self, property: str) -> float:
        """Return for how many seconds the kept answers of queries on a property count."""
        return next((rule.kept for rule in self.fields if property in rule.properties), 0.0)


def _mapping(
    value: object, file: str, element: str, keys: set[str] | None = None
) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise PolicyError(f"{file}: {element}: is {value!r}; give key: value")
    unknown = set(value) - keys if keys is not None else set()
    if unknown:
        raise PolicyError(
            f"{file}: {element}: unknown key {sorted(map(str, unknown))[0]}; "
            f"give some of {', '.join(sorted(keys or ()))}"
        )
    return value


def _layer(name: str, value: object, file: str) -> Layer:
    if name in (NONE, FLOOR, SOCIAL):
        raise PolicyError(f"{file}: layer {name}: this name is reserved; give a different one")
    fields = _mapping({} if value is None else value, file, f"layer {name}", {"padding"})
    return Layer(name, _number(fields, "padding", f"{file}: layer {name}", "metres"))


def _rule(value: object, number: int, layers: set[str], file: str) -> PolicyRule:
    where = f"{file}: rule {number}"
    fields = _mapping(
        value, file, f"rule {number}", {"kind", "type", "properties", "state", "layer"}
    )
    layer = _choice(fields, "layer", tuple(sorted(layers)), where)
    kind, state = (
        None if fields.get(key) is None else _choice(fields, key, choices, where)
        for key, choices in (("kind", KINDS), ("state", STATES))
    )
    types = _names(fields.get("type", []), f"{where}: type")
    properties = _mapping(fields.get("properties", {}), file, f"rule {number}, properties")
    return PolicyRule(layer, kind, types, tuple(properties.items()), state)


def _field_rule(value: object, number: int, layers: set[str], file: str) -> FieldRule:
    where = f"{file}: field rule {number}"
    fields = _mapping(value, file, f"field rule {number}", {"property", "layer", "kept"})
    properties = _names(fields.get("property", []), f"{where}: property")
    if not properties:
        raise PolicyError(f"{where}: property is missing; give a name or a list of names")
    layer = _choice(fields, "layer", tuple(sorted(layers)), where)
    return FieldRule(properties, layer, _number(fields, "kept", where, "seconds"))


def _number(fields: Mapping[str, Any], key: str, where: str, unit: str) -> float:
    found = fields.get(key, 0.0)
    if not (is_finite_number(found) and found >= 0):
        raise PolicyError(f"{where}: {key} is {found!r}; give 0 or more {unit}")
    return float(found)


def _choice(fields: Mapping[str, Any], key: str, choices: tuple[str, ...], where: str) -> str:
    found = fields.get(key)
    if not isinstance(found, str) or found not in choices:
        raise PolicyError(f"{where}: {key} is {found!r}; give one of {', '.join(choices)}")
    return found


def _names(value: object, element: str) -> tuple[str, ...]:
    """A name, or a list of names."""
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise PolicyError(f"{element} is {value!r}; give a name or a list of names")
    return tuple(names)
