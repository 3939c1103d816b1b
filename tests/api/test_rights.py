"""The table of operations names the least role that may do each: tried with every role."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import quote

import psycopg
import pytest
from psycopg.errors import InsufficientPrivilege
from sqlalchemy.exc import DBAPIError

import semmap
from semmap.api.operations import OPERATIONS
from tests.office import OFFICE, OFFICE_FILES

ROLES = ("reader", "robot", "admin")

SQUARE = ((0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8))

URDF = OFFICE / "delivery_robot.urdf"

RDF = "INSERT DATA { :mug7 prop:%s 'x' }"

Call = Callable[[semmap.Map, str], Any]
"""Does an operation in a map as a role, whose name keeps what it makes apart."""


def rename(flat: semmap.Map, role: str) -> None:
    flat[f"for_{role}"].name = f"renamed_{role}"


def close(flat: semmap.Map, role: str) -> None:
    flat.doors["door1"].state = "closed" if role == "robot" else "open"


def assign(attribute: str, values: dict[str, Any]) -> Call:
    def do(flat: semmap.Map, role: str) -> None:
        setattr(flat[f"for_{role}"], attribute, values[role])

    return do


CALLS: dict[str, Call] = {
    "Database.create_map": lambda flat, role: flat.database.create_map(f"of_{role}"),
    "Database.drop_map": lambda flat, role: flat.database.drop_map("spare"),
    "Database.import_file": lambda flat, role: flat.database.import_file(
        OFFICE_FILES[1], map=f"imported_{role}"
    ),
    "Database.add_robot": lambda flat, role: flat.database.add_robot(f"of_{role}", URDF),
    "Database.delete_robot": lambda flat, role: flat.database.delete_robot("spare"),
    "Map.import_file": lambda flat, role: flat.import_file(OFFICE_FILES[1]),
    "Map.add_storey": lambda flat, role: flat.add_storey(f"storey_{role}", elevation=10.0),
    "Map.add_room": lambda flat, role: flat.add_room(f"room_{role}", SQUARE, ceiling=2),
    "Map.add_door": lambda flat, role: flat.add_door(
        f"door_{role}", "kitchen", "hall", ((4.05, 2.1), (4.05, 2.9))
    ),
    "Map.add_region": lambda flat, role: flat.add_region(f"region_{role}", SQUARE),
    "Map.add_object": lambda flat, role: flat.add_object(
        f"plate_{role}", type="plate", size=(0.2, 0.2, 0.02), on="desk4"
    ),
    "Map.add_agent": lambda flat, role: flat.add_agent(f"agent_{role}", in_="hall"),
    "Map.draw_region": lambda flat, role: flat.draw_region(f"drawn_{role}", SQUARE, holder="hall"),
    "Map.find_regions": lambda flat, role: flat.find_regions("surfaces", "desk4"),
    "Map.observe": lambda flat, role: flat.observe("mug7", "desk4"),
    "Map.observe_point": lambda flat, role: flat.observe_point("mug7", (0.8, 0.4, 0.1)),
    "Map.observe_view": lambda flat, role: flat.observe_view((2, 1, 1.2, 0, 0.4), ["mug7"]),
    "Map.update": lambda flat, role: flat.update(RDF % f"of_{role}"),
    "Map.reason": lambda flat, role: flat.reason(),
    "Map.forget_inferences": lambda flat, role: flat.forget_inferences(),
    "MapEntity.name": rename,
    "MapEntity.type": assign("type", {"reader": "mug", "robot": "plate", "admin": "bowl"}),
    "MapEntity.label": assign("label", {role: f"of {role}" for role in ROLES}),
    "MapEntity.properties": assign("properties", {role: {"of": role} for role in ROLES}),
    "MapEntity.move_to": lambda flat, role: flat[f"for_{role}"].move_to(
        5 + ROLES.index(role), 0.5, 0
    ),
    "MapEntity.put_on": lambda flat, role: flat[f"for_{role}"].put_on("desk4"),
    "MapEntity.put_in": lambda flat, role: flat[f"for_{role}"].put_in("kitchen"),
    "MapEntity.delete": lambda flat, role: flat[f"gone_{role}"].delete(),
    "Door.state": close,
    # what everybody may do
    "MapEntity.pose": lambda flat, role: flat["mug7"].pose,
    "MapEntity.describe": lambda flat, role: flat["mug7"].describe(),
    "Map.find": lambda flat, role: flat.find("mug", in_="kitchen"),
    "Map.changes": lambda flat, role: flat.changes(),
    "Map.check": lambda flat, role: flat.check(),
    "Map.grid": lambda flat, role: flat.grid("ground"),
    "Map.route": lambda flat, role: flat.route("kitchen", "hall"),
    "Map.search": lambda flat, role: flat.search("mug7", start="hall"),
    "Map.where": lambda flat, role: flat.where("mug7"),
    "Map.sparql": lambda flat, role: flat.sparql("SELECT ?m { ?m a semmap:Mug }"),
    "Map.sql": lambda flat, role: flat.sql("SELECT count(*) FROM object"),
    "Map.graph": lambda flat, role: flat.graph(),
    "Map.r2rml": lambda flat, role: flat.r2rml(),
    "Map.contradictions": lambda flat, role: flat.contradictions(),
    "SpatialFields.at": lambda flat, role: flat.fields.at(1, 0.4, 0.7),
    "SpatialFields.ls": lambda flat, role: flat.fields.ls(),
    "SpatialFields.kept": lambda flat, role: flat.fields.kept(),
}


@pytest.fixture
def roles(flat: semmap.Map, database: str) -> Iterator[dict[str, semmap.Map]]:
    """The flat as each role sees it."""
    flat.database.create_map("spare")
    flat.database.add_robot("spare", URDF)
    flat.reason()
    for role in ROLES:
        for name in (f"for_{role}", f"gone_{role}"):
            flat.add_object(name, type="cup", in_="hall")
    sign = "&" if "?" in database else "?"
    opened = {
        role: semmap.connect(f"{database}{sign}options={quote(f'-c role=semmap_{role}')}")
        for role in ROLES
    }
    yield {role: db.map("flat") for role, db in opened.items()}
    for db in opened.values():
        db.close()


def may(flat: semmap.Map, method: str, role: str) -> bool:
    """Whether the server lets a role do an operation."""
    try:
        CALLS[method](flat, role)
    except (semmap.Error, psycopg.Error, DBAPIError) as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, InsufficientPrivilege):
            cause = cause.__cause__
        if cause is None:
            raise
        return False
    return True


@pytest.mark.parametrize("method", CALLS)
def test_the_least_role_may_and_the_ones_below_may_not(
    roles: dict[str, semmap.Map], method: str
) -> None:
    (right,) = {each.right for each in OPERATIONS if each.method == method}
    least = ROLES.index(right)
    expected = {role: number >= least for number, role in enumerate(ROLES)}
    assert {role: may(flat, method, role) for role, flat in roles.items()} == expected


def test_a_robot_that_may_not_change_a_room_is_told_so(roles: dict[str, semmap.Map]) -> None:
    """Policies leave out rows without an error: what finds none was not done."""
    with pytest.raises(InsufficientPrivilege, match="the rights of the role do not allow this"):
        roles["robot"].fields.update(
            'INSERT DATA { :kitchen :occupies "SPHERE(1 2 0.8 0.2)"^^:region }'
        )
    assert roles["admin"].fields.kept() == []


def test_a_robot_adds_what_an_admin_adds(roles: dict[str, semmap.Map]) -> None:
    """The same box at one place has the same holder, and holds what stands on it."""
    held = {}
    for role in ("robot", "admin"):
        flat = roles[role]
        pose = (2 if role == "robot" else 6, 2, 0)
        stool = flat.add_object(
            f"stool_{role}", size=(0.4, 0.4, 0.4 if role == "robot" else 0.41), pose=pose
        )
        cup = flat.add_object(f"cup_{role}", size=(0.1, 0.1, 0.1), pose=(*pose[:2], stool.size[2]))
        held[role] = [(stool.holder.name, stool.relation), (cup.holder.name, cup.relation)]
    assert held == {
        "robot": [("kitchen", "in"), ("stool_robot", "on")],
        "admin": [("hall", "in"), ("stool_admin", "on")],
    }
