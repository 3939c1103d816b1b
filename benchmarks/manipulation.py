"""Retrieval among 1,000,000 stored grasps: by function, instance, type and shape."""

from __future__ import annotations

import random
import time
from typing import Any

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, medians_in_turn, print_rows
from semmap.manipulation.reader import actions_by_shape, actions_on
from semmap.manipulation.store.devices import add_gripper
from tests.seen import seen_by

__all__ = ["main"]

GRASPS, MODELS, INSTANCES = 1_000_000, 10_000, 2_000
GRIPPERS = ("pr2", "panda", "tiago", "schunk")
NAME = "grasps"

FILL = """
INSERT INTO object_model (key, name, type, shape, size, shape_pose)
SELECT 'bench:' || i, 'model' || i, (ARRAY['mug', 'wine_glass', 'book', 'tool', 'plate', 'toy',
       'pen', 'box', 'shoe', 'bag'])[1 + i %% 10], 'cylinder',
       ARRAY[0.02 + 0.06 * random(), 0.05 + 0.3 * random()],
       '{0,0,0,0,0,0,1}' FROM generate_series(0, %(models)s - 1) i;
INSERT INTO action (kind, object_id, gripper_id, pose, pre_pose, approach, family, width, posture,
                    pre_posture, quality)
SELECT 'grasp', o.id, g.device_id, ARRAY[random(), random(), random(), 0, 0, 0, 1],
       ARRAY[random(), random(), random(), 0, 0, 0, 1], 'side', 'side x 45', 0.05,
       '{"finger": 0.02}', '{"finger": 0.04}', random()
FROM object_model o, gripper g, generate_series(1, %(each)s) n WHERE o.key LIKE 'bench:%%';
"""


def make_map(db: semmap.Database) -> semmap.Map:
    """A map with instances of the models, and grasps of each by four grippers."""
    made = db.create_map(NAME)
    if not db.session.execute("SELECT 1 FROM action LIMIT 1").fetchone():
        for gripper in GRIPPERS:
            add_gripper(db.session, gripper, form="parallel", opening=0.09, depth=0.05)
        start = time.perf_counter()
        values = {"models": MODELS, "each": GRASPS // MODELS // len(GRIPPERS)}
        for statement in FILL.split(";\n")[:2]:
            db.session.execute(statement.encode(), values)
        print(f"{GRASPS:,} grasps stored: {time.perf_counter() - start:.0f} s", flush=True)
    with made.transaction():
        made.execute(
            "INSERT INTO model (digest, kind, triangles, hull) SELECT 'bench' || i, 'mesh', 12, "
            "'MULTIPOINTZ (0 0 0, 1 1 1)' FROM generate_series(0, %s) i",
            MODELS - 1,
        )
        made.execute(
            "INSERT INTO object_mesh (digest, object_id) SELECT 'bench' || i, o.id "
            "FROM generate_series(0, %s) i JOIN object_model o ON o.key = 'bench:' || i "
            "ON CONFLICT DO NOTHING",
            MODELS - 1,
        )
        made.execute(
            "INSERT INTO entity (map_id, kind, name, type) SELECT current_map(), 'object', "
            "'thing' || i, o.type FROM generate_series(0, %s) i "
            "JOIN object_model o ON o.key = 'bench:' || (i * 7 %% %s)",
            INSTANCES - 1,
            MODELS,
        )
        made.execute(
            "INSERT INTO entity_model (entity_id, model_id) SELECT e.id, m.id FROM entity e "
            "JOIN model m ON m.digest = 'bench' || (substr(e.name, 6)::int * 7 %% %s) "
            "WHERE e.map_id = current_map() AND e.name LIKE 'thing%%'",
            MODELS,
        )
        made.execute(
            "INSERT INTO placement (entity_id, pose) SELECT id, ARRAY[id % 40, id % 31, 0.8, "
            "0, 0, 0, 1] FROM entity WHERE map_id = current_map() AND starts_with(name, 'thing')"
        )
    db.session.execute("VACUUM (ANALYZE) action, object_model, object_mesh, entity, entity_model")
    return made


def rows(made: semmap.Map) -> list[Row]:
    """Time the queries, each time with other values, beside SELECT 1."""
    session = made.connection
    seen = seen_by(session)
    source = random.Random(1)

    def gripper() -> str:
        return source.choice(GRIPPERS)

    queries: dict[str, Any] = {
        "in the map, by function": lambda: actions_on(
            seen, function=source.choice(("drinking", "reading")), gripper=gripper()
        ),
        "of all models, by function": lambda: session.execute(
            "SELECT * FROM known_actions(%s, %s)",
            (source.choice(("drinking", "writing")), gripper()),
        ).fetchall(),
        "by instance": lambda: actions_on(
            seen, name=f"thing{source.randrange(INSTANCES)}", gripper=gripper()
        ),
        "by type": lambda: actions_on(seen, name="mug", gripper=gripper()),
        "by shape within 2 mm": lambda: actions_by_shape(
            session,
            "cylinder",
            (source.uniform(0.03, 0.07), source.uniform(0.1, 0.3)),
            tolerance=0.002,
            gripper=gripper(),
        ),
    }
    full = {name: run() for name, run in queries.items()}
    print({name: len(found) for name, found in full.items()})
    found = []
    for name, run in queries.items():
        seconds, nothing = medians_in_turn(
            run, lambda: session.execute("SELECT 1").fetchall(), times=101, warm_up=20
        )
        found.append(
            Row(
                f"{GRASPS:,} grasps, 10 best {name}",
                f"{seconds * 1e3:.2f} ms",
                f"SELECT 1: {nothing * 1e3:.2f} ms",
                "< 5 ms",
                seconds < 5e-3,
            )
        )
    return found


def main() -> None:
    """Print the table."""
    use_bench_database("manipulation")
    with semmap.connect(migrate=True) as db:
        if NAME in db.maps:
            db.drop_map(NAME)
        print_rows("Manipulation knowledge", rows(make_map(db)))
