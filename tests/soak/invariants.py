"""What is true of a map at each moment, whatever was killed."""

from __future__ import annotations

import json
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import Connection, Engine

import semmap
from semmap.database.maps import see_map
from semmap.fields.service.client import find_service
from semmap.fields.store.names import read_map_vocabulary
from semmap.fields.store.source_history import load_updates
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.query.entity_query import changes_since
from tests.consistency import POSES
from tests.seen import seen_by
from tests.soak.kept_span import kept_span

NEVER = {
    "world poses that do not follow from the placements": POSES,
    "placements without a world pose, or the reverse": (
        "SELECT entity_id FROM placement p FULL JOIN world w USING (entity_id) "
        "WHERE p.entity_id IS NULL OR w.entity_id IS NULL"
    ),
    "former placements that do not end where the next one begins": (
        "SELECT entity_id FROM (SELECT entity_id, upper(during) AS ends, coalesce(lead("
        "lower(during)) OVER (PARTITION BY entity_id ORDER BY lower(during)), p.since) AS begins "
        "FROM placement_history h JOIN placement p USING (entity_id)) v WHERE ends <> begins"
    ),
    "former versions that do not end where the next one begins": (
        "SELECT entity_id FROM (SELECT entity_id, upper(during) AS ends, coalesce(lead("
        "lower(during)) OVER (PARTITION BY entity_id ORDER BY lower(during)), e.since) AS begins "
        "FROM entity_history h JOIN entity e ON e.id = h.entity_id) v WHERE ends <> begins"
    ),
    "former placements or versions that lasted no time": (
        "SELECT entity_id FROM placement_history WHERE isempty(during) "
        "UNION ALL SELECT entity_id FROM entity_history WHERE isempty(during)"
    ),
    "supertypes that do not follow from the T-Box": (
        "SELECT e.id FROM entity e WHERE NOT EXISTS (SELECT FROM object_type o WHERE o.id = e.id)"
    ),
    "entities without the change that added them": (
        "SELECT e.id FROM entity e WHERE NOT EXISTS "
        "(SELECT FROM change c WHERE c.what = 'added' AND e.id = ANY (c.entities))"
    ),
}
"""Queries that return no row."""

STATED = "SELECT ?s ?n { ?s <urn:soak:count> ?n }"
"""The numbers that were stated, one of each entity."""


def last_line(file: Path) -> str:
    """The last line that was written as a whole; empty if there is none."""
    if not file.exists():
        return ""
    return (["", *file.read_text().split("\n")[:-1]])[-1]


def signature(connection: Connection, map_name: str) -> str:
    """The names, types and poses of a map, as one text."""
    rows = connection.exec_driver_sql(
        "SELECT e.name, e.type, round(w.pose[1]::numeric, 3), round(w.pose[2]::numeric, 3) "
        "FROM entity e JOIN map m ON m.id = e.map_id LEFT JOIN world w ON w.entity_id = e.id "
        "WHERE m.name = %s ORDER BY e.name",
        (map_name,),
    )
    return repr(rows.all())


def violations(engine: Engine, state: Path, imported: str, versions: set[str]) -> list[str]:
    """What is wrong now.

    Parameters
    ----------
    state : the folder of the actors
    imported, versions : a map, and the signatures that it may have
    """
    wrong = []
    with engine.connect() as connection:
        for what, query in NEVER.items():
            found = connection.exec_driver_sql(f"{query} LIMIT 5").scalars().all()
            if found:
                wrong.append(f"{what}: {found}")
        for file in state.glob("writer-*"):
            entity = int(file.name.partition("-")[2])
            acknowledged = int(last_line(file) or 0)
            stored = connection.exec_driver_sql(
                "SELECT coalesce((properties->>'steps')::int, 0) FROM entity WHERE id = %s",
                (entity,),
            ).scalar_one()
            if stored < acknowledged:
                wrong.append(
                    f"entity {entity}: step {acknowledged} was committed, {stored} is there"
                )
        if signature(connection, imported) not in versions:
            wrong.append(f"the map {imported} is no version of its file")
    seen = state / "wrong"
    if seen.exists():
        wrong.append(seen.read_text().strip())
    return wrong


def url_of(engine: Engine) -> str:
    """The URL of an engine's database."""
    return engine.url.set(drivername="postgresql").render_as_string(hide_password=False)


def wrong_service(engine: Engine, map_name: str, file: Path) -> list[str]:
    """What a service kept that is not there, and how a service fails to answer.

    Parameters
    ----------
    file : the times of the newest look that was kept, as an actor saw it
    """
    wrong = []
    with engine.connect() as connection:
        see_map(connection, map_name)
        span, seen = kept_span(connection), last_line(file)
        if seen and (span is None or span[1] < datetime.fromisoformat(seen)):
            wrong.append(f"the look of {seen} was kept, the newest one is {span and span[1]}")
        load_updates(seen_by(connection), read_map_vocabulary())
    try:
        with find_service(url_of(engine), map_name) as found:
            if found is not None:
                found.ask("query", text="PREFIX : <urn:semmap:ontology#> ASK { :visitor :sees ?o }")
                if "recorded" not in {each["name"] for each in found.ask("sources")}:
                    wrong.append("the service plays its recording no longer")
    except (ConnectionError, ValueError) as error:
        wrong.append(f"the service answers: {error}")
    return wrong


def stated_numbers(engine: Engine, map_name: str) -> set[tuple[str, int]]:
    """The entities of a map with the numbers that are stated of them."""
    with semmap.connect(url_of(engine)) as db:
        return {(str(s), int(n)) for s, n in db.map(map_name).sparql(STATED)}


def wrong_statements(engine: Engine, map_name: str, state: Path) -> list[str]:
    """The numbers that were acknowledged and are not stated, or are beside a former one."""
    acknowledged = {
        file.name.partition("-")[2]: int(last_line(file) or 0) for file in state.glob("stated-*")
    }
    stated = stated_numbers(engine, map_name)
    wrong = []
    for name, least in acknowledged.items():
        numbers = [number for entity, number in stated if entity == name]
        if least and (len(numbers) != 1 or numbers[0] < least):
            wrong.append(f"{name}: {least} was stated, {numbers} is there")
    return wrong


def wrong_follower(engine: Engine, map_name: str, file: Path, most: float = 600.0) -> list[str]:
    """Return how a follower differs from a new query, once nothing changes any more.

    Parameters
    ----------
    file : the answers of the follower
    most : seconds that it has to catch up
    """
    begin = time.monotonic()
    while True:
        stated = stated_numbers(engine, map_name)
        found = json.loads(file.read_text()) if file.exists() else {"count": -1, "seen": []}
        ended = {tuple(each) for each in found["seen"]} - stated
        if found["count"] == len(stated) and not ended:
            return []
        if time.monotonic() > begin + most:
            return [f"a follower has {found} where a new query has {sorted(stated)}"]
        time.sleep(0.1)


def wrong_cursors(connection: psycopg.Connection[Any], file: Path) -> list[str]:
    """The changes that a poller skipped, or read twice."""
    lines = [json.loads(line) for line in file.read_text().split("\n")[:-1]]
    _, rest = changes_since(connection, lines[-1]["cursor"])
    seen = [number for line in lines for number in line["ids"]] + [row["id"] for row in rest]
    stored = {number for (number,) in connection.execute("SELECT id FROM change")}
    wrong = []
    if skipped := stored - set(seen):
        wrong.append(f"the cursor skipped {len(skipped)} changes: {sorted(skipped)[:5]}")
    if len(seen) != len(set(seen)):
        wrong.append(f"the cursor showed {len(seen) - len(set(seen))} changes twice")
    if unknown := set(seen) - stored:
        wrong.append(f"the cursor showed {len(unknown)} changes that were not committed")
    return wrong


def wrong_mirror(engine: Engine, map_name: str) -> list[str]:
    """The entities whose voxels in the stored mirror differ from those of a new one."""
    stored, fresh = VoxelMirror.resume(engine, map_name), VoxelMirror(engine, map_name)
    stored.catch_up()
    fresh.catch_up()
    if stored.names != fresh.names:
        return [f"the mirror has {len(stored.names)} entities, not {len(fresh.names)}"]
    wrong = [
        name
        for number, name in fresh.names.items()
        if not np.array_equal(voxels_of(stored, number), voxels_of(fresh, number))
    ]
    return [f"the mirror of {name} is old" for name in wrong[:5]]


def voxels_of(mirror: VoxelMirror, entity: int) -> NDArray[np.int64]:
    """The voxels of an entity in order, each as one number."""
    return np.sort(mirror.regions.voxels(entity).astype(np.int64) @ [1, 1 << 20, 1 << 40])
