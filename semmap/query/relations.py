"""Spatial relations between entities, as operators for `select`.

>>> from semmap.model import Object
>>> print(on(Object, 7))
semmap.entity.id = ANY (ARRAY(SELECT member FROM semmap.things_on(:param_1, :param_2) AS member))

Each takes entities as classes, aliases, instances, ids or columns of ids, and gives a condition.
Where one side is a class and the relation has an index to ask, the condition is put as "is one of
those that", so that no map is scanned; between two classes, the index is asked once for each row of
the second.

The frame is the map's unless stated otherwise: metres, z up. Surfaces are compared, not boxes
(`schema/functions/4*.sql` say how). Relations hold within one map; they are false, never null, for
an entity without placement and between an entity and itself. Without geometry, an entity is a
point.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeAlias, cast

from sqlalchemy import (
    BigInteger,
    Boolean,
    ColumnElement,
    Double,
    Text,
    and_,
    any_,
    func,
    inspect,
    literal,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.orm import Mapper
from sqlalchemy.orm.util import AliasedClass, AliasedInsp
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import ARRAY, TypeEngine

from semmap.geometry.pose import Pose
from semmap.model import Entity, PoseColumn

__all__ = [
    "RELATIONS",
    "TOLERANCE",
    "Relation",
    "above",
    "behind",
    "between",
    "in_",
    "in_front_of",
    "left_of",
    "near",
    "on",
    "reachable_from",
    "right_of",
    "touching",
    "under",
]

Operand: TypeAlias = type[Entity] | AliasedClass[Any] | Entity | int | ColumnElement[int]
Frame: TypeAlias = str | Pose | Operand

TOLERANCE = 0.01
"""Metres by which contact may miss or overlap."""


@dataclass(frozen=True)
class Relation:
    """A relation, and the SQL functions behind it.

    Attributes
    ----------
    name : of the operator in this module
    function : the SQL function that decides it; entities first
    parameters : names of all its parameters, in order
    members : the SQL function that lists all `a` for one `b`, by index, if there is one
    converse : the SQL function that lists all `b` for one `a`, likewise
    """

    name: str
    function: str
    parameters: tuple[str, ...]
    members: str | None = None
    converse: str | None = None


RELATIONS = (
    Relation("in_", "is_in", ("a", "b", "tolerance"), "things_in", "containers_of"),
    Relation("on", "is_on", ("a", "b", "tolerance"), "things_on", "supports_of"),
    Relation("under", "is_under", ("a", "b", "tolerance"), "things_under", "things_above"),
    Relation("above", "is_above", ("a", "b", "tolerance"), "things_above", "things_under"),
    Relation(
        "touching", "is_touching", ("a", "b", "tolerance"), "things_touching", "things_touching"
    ),
    Relation("near", "is_near", ("a", "b", "distance"), "things_near", "things_near"),
    Relation("left_of", "is_left_of", ("a", "b", "frame")),
    Relation("right_of", "is_right_of", ("a", "b", "frame")),
    Relation("in_front_of", "is_in_front_of", ("a", "b", "frame")),
    Relation("behind", "is_behind", ("a", "b", "frame")),
    Relation("between", "is_between", ("a", "b", "c", "tolerance")),
    Relation("reachable_from", "is_reachable", ("place_a", "place_b")),
)
"""All relations: what they are called here and in SQL. Tests are driven by this table."""

_BY_NAME = {relation.name: relation for relation in RELATIONS}


def in_(a: Operand, b: Operand, tolerance: float = TOLERANCE) -> ColumnElement[bool]:
    """`b` contains `a`.

    A room does if more than half of the footprint of `a` lies in its outline, and at least half of
    the height of `a` between floor and ceiling (`tolerance` metres more on either end): a muffin on
    a desk is in the office. A region likewise, or if the bottom of `a` is at the region's. Any
    other thing does if its surface encloses `a`: on four sides, or below and above, or below and on
    three sides, seen along its own axes. Where `b` has no geometry, what the placements say counts.
    """
    return _indexed("in_", a, b, _metres(tolerance))


def on(a: Operand, b: Operand, tolerance: float = TOLERANCE) -> ColumnElement[bool]:
    """`a` rests on `b`, directly.

    `b` has surface within `tolerance` metres, up or down, of the lowest height of `a`, beneath its
    underside, and reaches lower than `a` does (where their bottoms are within `tolerance`: less
    high). A room or region: `a` is in it, and its bottom at the floor.
    """
    return _indexed("on", a, b, _metres(tolerance))


def above(a: Operand, b: Operand, tolerance: float = TOLERANCE) -> ColumnElement[bool]:
    """`a` is over `b`, on the same storey, at any height.

    On the plumb lines (up to 26) through ground that both cover, all of `a` is higher than all of
    `b`, or at most `tolerance` metres lower, and `a` reaches higher on average. What is on `b` is
    above it, too, but nothing is above or under what it is in.
    """
    return _indexed("above", a, b, _metres(tolerance))


def under(a: Operand, b: Operand, tolerance: float = TOLERANCE) -> ColumnElement[bool]:
    """`b` is `above` `a`: the ball between the legs of a table, and the floor beneath it."""
    return _indexed("under", a, b, _metres(tolerance))


def touching(a: Operand, b: Operand, tolerance: float = TOLERANCE) -> ColumnElement[bool]:
    """The surfaces of `a` and `b` are somewhere at most `tolerance` metres apart, or cross."""
    return _indexed("touching", a, b, _metres(tolerance))


def near(a: Operand, b: Operand, within: float) -> ColumnElement[bool]:
    """The surfaces of `a` and `b` are at most `within` metres apart, straight through anything.

    What is in a room or region is near it.
    """
    return _indexed("near", a, b, _metres(within))


def left_of(a: Operand, b: Operand, frame: Frame = "object") -> ColumnElement[bool]:
    """`a` is to the left of `b`, horizontally, on one storey.

    The middle of `a` is measured from the sides of the rectangle around the footprint of `b` along
    the frame's axes; the side on which it is furthest out is where it is (on a diagonal: both).
    There is no contact tolerance.

    Parameters
    ----------
    frame : whose left
        ``"object"``: that of `b`, which looks along its x axis turned by its `front`. ``"map"``:
        front is along the map's x axis, left along its y axis (REP 103). An entity or `Pose` (in
        the map's frame): an observer there who looks at `b`; what is in front of `b` is then on the
        observer's side of it.
    """
    return _sided("left_of", a, b, frame)


def right_of(a: Operand, b: Operand, frame: Frame = "object") -> ColumnElement[bool]:
    """`a` is to the right of `b`; frames as in `left_of`."""
    return _sided("right_of", a, b, frame)


def in_front_of(a: Operand, b: Operand, frame: Frame = "object") -> ColumnElement[bool]:
    """`a` is in front of `b`; frames as in `left_of`."""
    return _sided("in_front_of", a, b, frame)


def behind(a: Operand, b: Operand, frame: Frame = "object") -> ColumnElement[bool]:
    """`a` is behind `b`; frames as in `left_of`."""
    return _sided("behind", a, b, frame)


def between(
    a: Operand, b: Operand, c: Operand, tolerance: float = TOLERANCE
) -> ColumnElement[bool]:
    """`a` is between `b` and `c`, on one storey.

    Its middle lies in the convex hull of both footprints (`tolerance` metres more), but in neither
    of them, and its heights meet theirs; or it is above one and under the other.
    """
    return _decided("between", (a, b, c), _metres(tolerance))


def reachable_from(a: Operand, b: Operand) -> ColumnElement[bool]:
    """A way leads to `a` from `b`.

    Through connectors that are not locked, in their direction, and by elevator. An entity that is
    no room stands for the room that holds it. Topology: no frame, no tolerance.
    """
    if not _column(a):
        return _decided("reachable_from", (b, a))
    place = func.semmap.place_of(_id(a), type_=BigInteger)
    return place == any_(_Members(func.semmap.reachable_from(_id(b))))


class _Members(FunctionElement[list[int]]):
    """What a set-returning function lists, as an array: computed once, and the key of an index."""

    type = cast("TypeEngine[list[int]]", ARRAY(BigInteger))
    inherit_cache = True


@compiles(_Members)
def _compile_members(element: _Members, compiler: SQLCompiler, **kw: Any) -> str:
    # In FROM, not in SELECT: only there the planner expands the function and sees its index.
    return f"ARRAY(SELECT member FROM {compiler.process(element.clauses, **kw)} AS member)"


def _indexed(name: str, a: Operand, b: Operand, measure: ColumnElement[Any]) -> ColumnElement[bool]:
    relation = _BY_NAME[name]
    if relation.members and _column(a):
        members = getattr(func.semmap, relation.members)(_id(b), measure)
        return _id(a) == any_(_Members(members))
    if relation.converse and _column(b):
        members = getattr(func.semmap, relation.converse)(_id(a), measure)
        return _id(b) == any_(_Members(members))
    return _decided(name, (a, b), measure)


def _sided(name: str, a: Operand, b: Operand, frame: Frame) -> ColumnElement[bool]:
    if isinstance(frame, str):
        if frame not in ("map", "object"):
            raise ValueError(
                f"there is no frame {frame!r}: it is 'map', 'object', or an observer "
                "(an entity or a Pose)"
            )
        seen_from: ColumnElement[Any] = literal(frame, Text)
    elif isinstance(frame, Pose):
        seen_from = literal(frame, PoseColumn)
    else:
        seen_from = _id(frame)
    return _decided(name, (a, b), seen_from)


def _decided(
    name: str, entities: tuple[Operand, ...], *measure: ColumnElement[Any]
) -> ColumnElement[bool]:
    """The SQL function that decides the relation.

    No entity relates to itself: repeated between columns, it tells SQLAlchemy that they are
    joined.
    """
    function = getattr(func.semmap, _BY_NAME[name].function)
    holds = function(*map(_id, entities), *measure, type_=Boolean)
    columns = [_id(e) for e in entities if _column(e)]
    return and_(*(one != other for one, other in combinations(columns, 2)), holds)


def _metres(distance: float) -> ColumnElement[float]:
    if not 0 <= distance < float("inf"):
        raise ValueError(f"a distance in metres is finite and not negative, not {distance}")
    return literal(float(distance), Double)


def _column(operand: Operand) -> bool:
    """True for what stands for many entities: a class, an alias, a column of ids."""
    return not isinstance(operand, int | Entity)


def _id(operand: Operand) -> ColumnElement[int]:
    if isinstance(operand, bool):
        raise TypeError(f"an entity is a class, alias, instance, id or column, not {operand}")
    if isinstance(operand, int):
        return literal(operand, BigInteger)
    if isinstance(operand, Entity):
        if operand.id is None:
            raise ValueError(f"{operand!r} is not in the database yet: flush the session first")
        return literal(operand.id, BigInteger)
    if isinstance(operand, ColumnElement) or hasattr(operand, "__clause_element__"):
        return operand  # type: ignore[return-value]
    inspected = inspect(operand, raiseerr=False)
    if isinstance(inspected, Mapper | AliasedInsp) and issubclass(inspected.mapper.class_, Entity):
        return operand.id  # type: ignore[return-value]
    raise TypeError(f"an entity is a class, alias, instance, id or column, not {operand!r}")
