"""Calls of operations with arguments from JSON, whose answers are JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from typing import Any

import psycopg

from semmap.api.operations import OPERATIONS, Operation, Right
from semmap.api.signatures import REQUIRED, Argument
from semmap.draw.picture import Picture
from semmap.error import Error, InvalidArgumentError, RightsError
from semmap.plain_values import plain
from semmap.server.json_schema import NAMED, Schema, schema_of

_ROWS = {"Map.find": "Map.table"}
"""Methods that return entities, and those that return their rows."""


_WRITING = ("try_grasps", "write")
"""Arguments that let what only reads write."""


HINT = r" without write=True,|\. Add write=True.*"
"""What `Map.sql` says that servers do not offer."""

FILE = re.compile(r"/|\.(urdf|xml|xacro)$", re.IGNORECASE)
"""What a name has that would be read as a file on the server."""

MOST = {"seconds": 60, "rows": 50_000, "width": 4_000}
"""The most that a request may ask of an argument; the first two hold where it does not say."""


class OperationCall:
    """An operation of a map, or of the `entity` that is named, that programs call by name.

    What Python sets, such as the state of a door, has a `value` and the name ``set_state``.
    """

    def __init__(self, operation: Operation, most: Mapping[str, float] = MOST) -> None:
        self.operation, self._most = operation, most
        self._owner, _, self._member = operation.method.partition(".")
        sets = self._owner != "Map" and not operation.arguments and operation.result != "None"
        self._sets = sets and operation.right != "reader"
        self.name = f"set_{self._member}" if self._sets else self._member

    @cached_property
    def _arguments(self) -> list[Argument]:
        of = [] if self._owner == "Map" else [Argument("entity", "str", REQUIRED, "Its name")]
        value = [Argument("value", self.operation.result, REQUIRED, "")] * self._sets
        return [*of, *self.operation.arguments, *value]

    @cached_property
    def _files(self) -> set[str]:
        """The arguments whose texts would be names of files."""
        return {each.name for each in self._arguments if "Path" in each.annotation} - {*NAMED}

    @cached_property
    def arguments(self) -> dict[str, Schema]:
        """The JSON schema of each argument that JSON can give."""
        found = {each.name: schema_of(each) for each in self._arguments}
        left_out = _WRITING if self.operation.right == "reader" else ()
        return {n: each for n, each in found.items() if each is not None and n not in left_out}

    @cached_property
    def required(self) -> list[str]:
        """The arguments without a default."""
        return [each.name for each in self._arguments if each.default is REQUIRED]

    @property
    def schema(self) -> Schema:
        """The JSON schema of all arguments."""
        properties = {name.strip("_"): schema for name, schema in self.arguments.items()}
        return {
            "type": "object",
            "properties": properties,
            "required": [name.strip("_") for name in self.required],
            "additionalProperties": False,
        }

    def __call__(self, handle: Any, values: Mapping[str, Any]) -> Any:
        """What `result` returns, as plain values; a picture stays one."""
        found = self.result(handle, values)
        return found if isinstance(found, Picture) else plain(found)

    def result(self, handle: Any, values: Mapping[str, Any]) -> Any:
        """What the method of a map, or of an entity, returns.

        InvalidArgumentError for arguments that it does not have or take, the name of a file, and
        more than the server's limits.
        """
        names = {name.strip("_"): name for name in self.arguments}
        given: dict[str, Any] = {
            name: self._most[name] for name in ("seconds", "rows") if name in self.arguments
        }
        for word, value in values.items():
            if word not in names:
                known = ", ".join(names) or "none"
                raise InvalidArgumentError(f"{self.name} has no argument {word}: {known}")
            if word in NAMED and isinstance(value, str) and FILE.search(value):
                raise InvalidArgumentError(f"{word} is {value}: give the name of one in the map")
            given[names[word]] = self._value(names[word], value)
        if missing := [name for name in self.required if name not in given]:
            raise InvalidArgumentError(f"{self.name} needs {', '.join(missing)}")
        try:
            return self._done(handle, given)
        except Error as error:
            if isinstance(error.__cause__, psycopg.errors.InsufficientPrivilege):
                raise RightsError(str(error)) from error
            if not re.search(HINT, str(error)) or self._member != "sql":
                raise
            told = re.sub(HINT, "", str(error))  # an argument that `_WRITING` leaves out
            raise InvalidArgumentError(told) from error
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidArgumentError(f"{self.name}: {error}") from error

    def _done(self, handle: Any, given: dict[str, Any]) -> Any:
        target = handle if self._owner == "Map" else self._entity(handle, given.pop("entity"))
        if self._sets:
            return setattr(target, self._member, given["value"])
        method = _ROWS.get(self.operation.method, self.operation.method).partition(".")[2]
        found = getattr(target, method)
        return found(**given) if callable(found) else found  # a property of the map

    def _entity(self, handle: Any, name: str) -> Any:
        entity = handle[name]
        if not hasattr(type(entity), self._member):
            raise InvalidArgumentError(f"{name} is no door, but of the kind {entity.kind}")
        return entity

    def read(self, word: str, text: str) -> Any:
        """A value that an URL has as text: JSON, or itself where the argument takes a text."""
        schema = self.arguments.get(word, self.arguments.get(f"{word}_", {}))
        forms = schema.get("anyOf", [schema])
        try:
            value = json.loads(text)
        except (ValueError, RecursionError):
            return text
        takes_text = any(form.get("type") == "string" for form in forms)
        return text if takes_text and not isinstance(value, list | dict) else value

    def _value(self, name: str, value: Any) -> Any:
        most = self._most.get(name)
        if most is not None and isinstance(value, int | float) and not 0 < value <= most:
            raise InvalidArgumentError(
                f"{name} is {value}: give a number above 0, at most {most:g}"
            )
        texts = value if isinstance(value, list) else [value]
        if name in self._files and any(isinstance(each, str) for each in texts):
            raise InvalidArgumentError(
                f"{name}: files of the server are not read, give its content"
            )
        is_time = self.arguments[name].get("format") == "date-time"
        if not is_time or not isinstance(value, str):
            return value
        try:
            return datetime.fromisoformat(value)
        except ValueError:
            raise InvalidArgumentError(f"{name} is {value}: give a time of ISO 8601") from None


PLAIN = (
    "Any",
    "None",
    "Answer",
    "BelievedPlaces",
    "Finding",
    "FoundActions",
    "FoundRooms",
    "FoundRows",
    "GraphChanges",
    "Identity",
    "KnownAction",
    "MapPlan",
    "MapRoute",
    "ObjectSearch",
    "Picture",
    "Reasoned",
    "RobotClass",
    "SentenceAnswer",
    "SimulatedMission",
    "SqlRows",
    "Violation",
    "Why",
    "bool",
    "datetime",
    "dict",
    "float",
    "int",
    "list",
    "str",
    "tuple",
)
"""The words of results that JSON, or a picture, can tell."""

_LASTING = {"stop", "callback", "started"}
"""Arguments of methods that go on until they are told to stop."""


def answered_at_once(map_operations: Iterable[Operation]) -> list[str]:
    """The methods of a map that need no file, end by themselves and whose results are plain.

    Of entities, those that change them, and their history: `Map.describe` tells the rest.
    """
    return [
        each.method
        for each in map_operations
        if (each.method.startswith(("MapEntity.", "Door.")) and each.right != "reader")
        or each.method == "MapEntity.history"
        or (
            each.method.startswith("Map.")
            and each.command is not None
            and not _LASTING.intersection(argument.name for argument in each.arguments)
            and (each.method in _ROWS or {*re.findall(r"[A-Za-z]\w*", each.result)} <= {*PLAIN})
        )
    ]


def offered(
    methods: Sequence[str], rights: Collection[Right], most: Mapping[str, float] = MOST
) -> dict[str, OperationCall]:
    """The calls of those methods whose right is one of these, by their names."""
    known = {each.method: each for each in OPERATIONS if each.right in rights}
    found = [OperationCall(known[method], most) for method in methods if method in known]
    return {call.name: call for call in found if {*call.required} <= {*call.arguments}}
