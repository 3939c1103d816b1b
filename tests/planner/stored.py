"""A topology of dataclasses, written into a database."""

from __future__ import annotations

from sqlalchemy import Connection, text

from planner.topology import OUTSIDE, Topology
from semmap.geometry.pose import Pose


def store(connection: Connection, topology: Topology, name: str = "building") -> dict[str, int]:
    """Make a map of a topology; the ids of what it has, by name."""
    number = connection.execute(
        text("INSERT INTO map (name) VALUES (:name) RETURNING id"), {"name": name}
    ).scalar_one()
    connection.execute(text("SELECT set_config('semmap.map', :name, true)"), {"name": name})
    ids: dict[str, int] = {}

    def add(kind: str, rows: list[tuple[str, str | None]]) -> None:
        made = connection.execute(
            text(
                "INSERT INTO entity (map_id, kind, name, label) SELECT :map, :kind, n, l "
                "FROM unnest(CAST(:names AS text[]), CAST(:labels AS text[])) AS u (n, l) "
                "RETURNING name, id"
            ),
            {
                "map": number,
                "kind": kind,
                "names": [n for n, _ in rows],
                "labels": [label for _, label in rows],
            },
        )
        ids.update({row.name: row.id for row in made})

    places = [p for p in topology.places.values() if p.name != OUTSIDE]
    connectors = [*topology.connectors.values()]
    add("storey", [(s, None) for s in topology.storeys()])
    add("elevator", [(e, None) for e in topology.cabins()])
    add("room", [(p.name, p.label) for p in places])
    add("connector", [(c.name, None) for c in connectors])
    run = connection.execute
    for table, names in (("storey", topology.storeys()), ("elevator", [*topology.cabins()])):
        for n in names:
            run(text(f"INSERT INTO {table} (entity_id) VALUES (:id)"), {"id": ids[n]})
    run(
        text(
            "INSERT INTO room (entity_id, elevator_id) SELECT * FROM unnest("
            "CAST(:ids AS bigint[]), CAST(:lifts AS bigint[]))"
        ),
        {
            "ids": [ids[p.name] for p in places],
            "lifts": [None if p.elevator is None else ids[p.elevator] for p in places],
        },
    )
    if connectors:
        run(
            text(
                "INSERT INTO connector (entity_id, form, place_a, place_b, pose_a, pose_b, "
                "direction, state, behaviour, width, height, step, permissions) VALUES (:id, "
                ":form, :a, :b, :pose_a, :pose_b, :direction, :state, :behaviour, :width, :height, "
                ":step, :permissions)"
            ),
            [
                {
                    "id": ids[c.name],
                    "form": c.type,
                    "a": ids[_first(c.places)],
                    "b": ids.get(c.places[1]),
                    "pose_a": _seven(c.poses[0]),
                    "pose_b": _seven(c.poses[1]),
                    "direction": c.direction,
                    "state": c.state,
                    "behaviour": c.behaviour,
                    "width": c.width,
                    "height": c.height,
                    "step": c.step,
                    "permissions": sorted(c.permissions),
                }
                for c in connectors
            ],
        )
    entities = [*(p.name for p in places), *(c.name for c in connectors)]
    holders = {p.name: p.storey for p in places}
    above = {"ids": [ids[s] for s in topology.storeys()]}
    run(
        text("INSERT INTO placement (entity_id) SELECT i FROM unnest(CAST(:ids AS bigint[])) i"),
        above,
    )
    run(
        text(
            "INSERT INTO placement (entity_id, holder_id) SELECT * FROM unnest("
            "CAST(:ids AS bigint[]), CAST(:holders AS bigint[]))"
        ),
        {
            "ids": [ids[n] for n in entities],
            "holders": [ids.get(holders.get(n) or "") for n in entities],
        },
    )
    return ids


def _first(places: tuple[str, str]) -> str:
    assert places[0] != OUTSIDE, "in the map it is the second place that may be outside"
    return places[0]


def _seven(pose: Pose) -> list[float]:
    return [pose.x, pose.y, pose.z, pose.qx, pose.qy, pose.qz, pose.qw]
