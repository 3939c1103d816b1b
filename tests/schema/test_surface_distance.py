"""`surface_distance` and `is_nearer` beside FCL, on shapes with holes, cavities and thin walls."""

from __future__ import annotations

import itertools
from typing import Any

import fcl
import numpy as np
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, text

from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.geometry.pose import Pose
from tests.query.office_scene import bodies, store

MAPS = itertools.count()


def of_trimesh(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices), shape.faces.astype(np.int32))


SHAPES = {
    "ring": of_trimesh(trimesh.creation.torus(0.5, 0.1, major_sections=24, minor_sections=10)),
    "ball": of_trimesh(trimesh.creation.icosphere(subdivisions=2, radius=0.2)),
    "tube": of_trimesh(trimesh.creation.annulus(0.4, 0.5, 1.2, sections=40)),
    "rod": of_trimesh(trimesh.creation.capsule(1.5, 0.03, count=[8, 8])),
    "plate": box_mesh((-0.8, -0.4, 0), (0.8, 0.4, 0.02)),
    "crumbs": join(
        [
            box_mesh(tuple(at), tuple(at + 0.1))
            for at in np.random.default_rng(4).uniform(-1, 1, (40, 3))
        ]
    ),
}

poses = st.builds(
    Pose.from_rpy,
    *(st.floats(-1.5, 1.5) for _ in range(3)),
    *(st.sampled_from([0.0, 1.5707963267948966, 0.3, -2.2]) for _ in range(3)),
)


def oracle(a: Mesh, at_a: Pose, b: Mesh, at_b: Pose) -> float:
    """Metres between two sets of triangles, by FCL; 0 where they meet."""
    objects = []
    for mesh, pose in ((a, at_a), (b, at_b)):
        model = fcl.BVHModel()
        model.beginModel(len(mesh.vertices), len(mesh.faces))
        model.addSubModel(pose.apply(mesh.vertices), mesh.faces)
        model.endModel()
        objects.append(fcl.CollisionObject(model))
    if fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return float(fcl.distance(*objects, fcl.DistanceRequest(), fcl.DistanceResult()))


def ask(engine: Engine, sql: str, **values: Any) -> Any:
    with engine.connect() as connection:
        return connection.execute(text(f"SELECT {sql}"), values).scalar_one()


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(names=st.tuples(*2 * [st.sampled_from(sorted(SHAPES))]), at=st.tuples(poses, poses))
def test_distances_are_those_of_fcl(
    module_engine: Engine, names: tuple[str, str], at: tuple[Pose, Pose]
) -> None:
    meshes = [SHAPES[name] for name in names]
    world = bodies("pair", meshes)
    for entry, pose in zip(world.entries, at, strict=True):
        entry.pose = pose
    ids = store(module_engine, f"pair{next(MAPS)}", world)
    a, b = ids["body0"], ids["body1"]
    expected = oracle(meshes[0], at[0], meshes[1], at[1])
    found = ask(module_engine, "surface_distance(:a, :b)", a=a, b=b)
    assert abs(found - expected) < 1e-6
    assert abs(ask(module_engine, "surface_distance(:b, :a)", a=a, b=b) - expected) < 1e-6
    nearer = "is_nearer(:a, :b, :far, {})"
    for far, is_less, is_not_more in (
        (found * 1.001 + 1e-5, True, True),
        (found, False, True),
        (found * 0.999 - 1e-5, False, False),
    ):
        assert ask(module_engine, nearer.format("false"), a=a, b=b, far=far) is is_less
        assert ask(module_engine, nearer.format("true"), a=a, b=b, far=far) is is_not_more


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 10_000), apart=st.floats(0, 2), longest=st.floats(0.01, 0.6))
def test_sets_that_are_divided_have_the_distance_of_fcl(
    module_engine: Engine, seed: int, apart: float, longest: float
) -> None:
    dice = np.random.default_rng(seed)
    meshes, texts = [], []
    for start in (0.0, apart):
        corners = dice.uniform(0, 1, (90, 1, 3)) + dice.uniform(-longest, longest, (90, 3, 3))
        corners[:, :, 0] += start
        meshes.append(Mesh(corners.reshape(-1, 3), np.arange(270, dtype=np.int32).reshape(-1, 3)))
        closed = corners[:, [0, 1, 2, 0]]
        rings = (", ".join(f"{x!r} {y!r} {z!r}" for x, y, z in ring) for ring in closed.tolist())
        texts.append([f"TRIANGLE Z (({ring}))" for ring in rings])
    sets = (f"ARRAY(SELECT g::geometry FROM unnest(CAST(:{name} AS text[])) g)" for name in "ab")
    expected = oracle(meshes[0], Pose(), meshes[1], Pose())
    sql = f"nearest_patches({', '.join(sets)}, :reach)"
    found = ask(module_engine, sql, a=texts[0], b=texts[1], reach=10.0)
    assert abs(found - expected) < 1e-6
    kept = ask(module_engine, sql, a=texts[0], b=texts[1], reach=expected / 2)
    assert kept == expected / 2, "none is nearer"


def test_a_point_has_a_distance_to_each_shape(module_engine: Engine) -> None:
    """A thing without geometry, beside shapes that are not convex, by trimesh."""
    world = bodies("shapes", list(SHAPES.values()))
    ids = store(module_engine, f"points{next(MAPS)}", world)
    places = np.random.default_rng(5).uniform(-1, 1, (12, 3))
    add = text(
        "WITH e AS (INSERT INTO entity (map_id, kind, name) "
        "SELECT map_id, 'object', :name FROM entity WHERE id = :beside RETURNING id) "
        "INSERT INTO placement (entity_id, pose) SELECT id, ARRAY[:x, :y, :z, 0, 0, 0, 1] FROM e "
        "RETURNING entity_id"
    )
    for number, place in enumerate(places):
        named = {"name": f"point{number}", "beside": ids["body0"]}
        with module_engine.begin() as connection:
            values = {**named, **dict(zip("xyz", map(float, place), strict=True))}
            point = connection.execute(add, values).scalar_one()
        for body, mesh in enumerate(SHAPES.values()):
            shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            expected = trimesh.proximity.closest_point(shape, [place])[1][0]
            for a, b in ((point, ids[f"body{body}"]), (ids[f"body{body}"], point)):
                found = ask(module_engine, "surface_distance(:a, :b)", a=a, b=b)
                assert abs(found - expected) < 1e-6


def test_limits_are_exact_and_what_has_no_place_has_no_distance(module_engine: Engine) -> None:
    cube = box_mesh((0, 0, 0), (1, 1, 1))
    world = bodies("cubes", [cube, cube, cube])
    for x, entry in zip((0, 2, 3), world.entries, strict=True):
        entry.pose = Pose(float(x), 0, 0)
    ids = store(module_engine, f"cubes{next(MAPS)}", world)
    other = store(module_engine, f"cubes{next(MAPS)}", bodies("cube", [cube]))["body0"]
    first, second, third = (ids[f"body{i}"] for i in range(3))

    def compared(a: int, b: int, far: float | None) -> tuple[Any, Any]:
        sql = "is_nearer(:a, :b, CAST(:far AS float8), {})"
        return (
            ask(module_engine, sql.format("false"), a=a, b=b, far=far),
            ask(module_engine, sql.format("true"), a=a, b=b, far=far),
        )

    distance = "surface_distance(:a, :b)"
    assert ask(module_engine, distance, a=first, b=second) == 1
    assert compared(first, second, 1) == (False, True)
    assert compared(first, second, np.nextafter(1, 2)) == (True, True)
    for a, b in ((second, third), (first, first)):
        assert ask(module_engine, distance, a=a, b=b) == 0
        assert compared(a, b, 0) == (False, True)
        assert compared(a, b, -1) == (False, False)
        assert compared(a, b, 1e-300) == (True, True)
    assert ask(module_engine, distance, a=first, b=other) is None
    assert compared(first, other, 9) == (None, None)
    assert compared(first, second, None) == (None, None)
    assert compared(first, second, float("nan")) == (None, None)
    assert compared(first, second, float("inf")) == (True, True)
    assert ask(module_engine, distance, a=first, b=-1) is None
