"""Calls of every function of the native modules with arguments that it cannot take."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import semmap_native
import semmap_vdb
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid, RegionMap, Shape

Call = Callable[[], Any]

NAN, INF, HUGE = float("nan"), float("inf"), 1e300
F, I4, I8, U8 = np.float64, np.int32, np.int64, np.uint8

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], F)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], I4)
DEPTH = np.ones((4, 5), np.float32)
CAMERA = (10.0, 10.0, 2.0, 2.0)
UNMOVED = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0]]
POINTS = np.zeros((2, 3))


def unaligned(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The same array one byte off."""
    raw = np.zeros(array.nbytes + 1, U8)
    made = raw[1:].view(array.dtype).reshape(array.shape)
    made[...] = array
    return made


def every_second(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The same array with gaps between its rows."""
    return np.repeat(array, 2, axis=0)[::2]


def wrong_arrays(good: np.ndarray[Any, Any]) -> Iterator[tuple[str, Any]]:
    """Arrays of another shape, order or type."""
    yield "no array", None
    yield "text", "text"
    yield "a list of text", ["a"]
    yield "of 0 dimensions", np.array(1, good.dtype)
    yield "of a dimension more", good[None]
    yield "flat" if good.ndim > 1 else "of a dimension more", good.reshape(-1)[None, None]
    yield "of complex numbers", good.astype(complex)
    yield "of objects", good.astype(object)
    if good.dtype.itemsize > 1:
        yield "unaligned", unaligned(good)
    if good.ndim > 1:
        yield "flattened", good.reshape(-1)
        yield "with a column less", np.ascontiguousarray(good[:, :-1])
        yield "with a column more", np.column_stack([good, good[:, :1]])


def wrong_numbers(*more: float) -> Iterator[tuple[str, Any]]:
    for value in (NAN, INF, -INF, HUGE, -HUGE, *more):
        yield repr(value), value
    yield "text", "text"
    yield "None", None


def wrong_counts(*more: int) -> Iterator[tuple[str, Any]]:
    for value in (-1, -(2**31), 2**31, 2**40, 2**63 - 1, 2**64, *more):
        yield str(value), value
    yield "0.5", 0.5
    yield "None", None


Arguments = dict[str, Any]
Wrong = dict[str, Iterator[tuple[str, Any]]]


def variants(
    name: str, function: Callable[..., Any], good: Arguments, wrong: Wrong
) -> Iterator[tuple[str, Call]]:
    """One call for each wrong value of each argument, the others being good."""
    for argument, values in wrong.items():
        for text, value in values:
            changed = good | {argument: value}
            yield f"{name}: {argument} {text}", lambda changed=changed: function(**changed)  # type: ignore[misc]


def native_calls() -> Iterator[tuple[str, Call]]:
    """Of semmap_native."""
    mesh: Arguments = {
        "vertices": VERTICES,
        "faces": FACES,
        "solids": None,
        "solid_count": 1,
        "threads": 1,
    }
    wrong_mesh = {
        "vertices": [
            *wrong_arrays(VERTICES),
            ("with gaps", every_second(VERTICES)),
            ("of whole numbers", FACES),
        ],
        "faces": [
            *wrong_arrays(FACES),
            ("with gaps", every_second(FACES)),
            ("beyond the vertices", FACES + 1),
            ("below 0", FACES - 1),
            ("at the end of int32", FACES + (2**31 - 4)),
            ("at the end of int64", FACES.astype(I8) + (2**63 - 4)),
            ("of floats", VERTICES),
        ],
        "solids": [
            ("one less", np.zeros(3, I4)),
            ("none", np.zeros(0, I4)),
            ("of two dimensions", np.zeros((4, 1), I4)),
            ("of int64", np.zeros(4, I8)),
            ("below 0", np.full(4, -1, I4)),
            ("beyond solid_count", np.full(4, 1, I4)),
            ("unaligned", unaligned(np.zeros(4, I4))),
        ],
        "solid_count": wrong_counts(0),
        "threads": wrong_counts(0, 10_000),
    }
    yield from variants("closed_solids", semmap_native.closed_solids, mesh, {**wrong_mesh})
    filled = [
        ("none", np.zeros(0, bool)),
        ("too many", np.zeros(9, bool)),
        ("of bytes", np.zeros(1, U8)),
        ("of two dimensions", np.zeros((1, 1), bool)),
    ]
    good = mesh | {
        "intervals": [(0.0, 0.5)],
        "origin_x": 0.0,
        "origin_y": 0.0,
        "resolution": 0.1,
        "rows": 10,
        "columns": 12,
        "fill": True,
        "filled": None,
    }
    yield from variants(
        "occupancy",
        semmap_native.occupancy,
        good,
        {
            **wrong_mesh,
            "intervals": [
                ("upside down", [(1.0, 0.0)]),
                ("NaN", [(NAN, 1.0)]),
                ("infinite", [(0.0, INF)]),
                ("single numbers", [1.0]),
                ("None", None),
            ],
            "origin_x": wrong_numbers(),
            "origin_y": wrong_numbers(),
            "resolution": wrong_numbers(0.0, -0.1, 1e-200),
            "rows": wrong_counts(),
            "columns": wrong_counts(),
            "filled": filled,
        },
    )
    yield (
        "occupancy: more cells than fit",
        lambda: semmap_native.occupancy(**good | {"rows": 2**24, "columns": 2**24}),
    )
    yield (
        "occupancy: vertices NaN",
        lambda: semmap_native.occupancy(**good | {"vertices": np.full((4, 3), NAN)}),
    )
    costs = np.zeros(26, U8)
    grid = np.zeros((6, 7), bool)
    yield from variants(
        "inflate",
        semmap_native.inflate,
        {"occupied": grid, "radius": 5, "costs": costs, "variant": None},
        {
            "occupied": [*[*wrong_arrays(grid)][:-2], ("of bytes", grid.view(U8))],
            "radius": wrong_counts(0, 4, 6, 46_341, 65_536),
            "costs": [
                ("none", costs[:0]),
                ("one less", costs[:-1]),
                ("one more", np.zeros(27, U8)),
                ("of two dimensions", costs[None]),
                ("of int64", costs.astype(I8)),
            ],
            "variant": [("unknown", "neon"), ("a number", 1)],
        },
    )
    terrain = np.zeros((6, 7), U8)
    cells = np.array([[0, 0], [5, 6]], I8)
    outside = [
        ("beyond the rows", np.array([[6, 0], [0, 0]], I8)),
        ("beyond the columns", np.array([[0, 7], [0, 0]], I8)),
        ("below 0", np.array([[-1, 0], [0, 0]], I8)),
        ("huge", np.full((2, 2), 2**62, I8)),
        ("of int32", cells.astype(I4)),
    ]
    ground: Arguments = {"costs": terrain, "resolution": 0.1, "slow": 1.0}
    wrong_ground = {
        "costs": [*[*wrong_arrays(terrain)][:-2], ("of bool", terrain.astype(bool))],
        "resolution": list(wrong_numbers(0.0, -1.0)),
        "slow": list(wrong_numbers(-0.1, 1e9)),
    }
    yield from variants(
        "travel",
        semmap_native.travel,
        {**ground, "cells": cells, "targets": None, "threads": 1},
        {
            **{k: iter(v) for k, v in wrong_ground.items()},
            "cells": [*wrong_arrays(cells), *outside],
            "targets": [*[w for w in wrong_arrays(cells) if w[1] is not None], *outside[:-1]],
            "threads": wrong_counts(0, 10_000),
        },
    )
    yield from variants(
        "way",
        semmap_native.way,
        {**ground, "ends": cells},
        {
            **{k: iter(v) for k, v in wrong_ground.items()},
            "ends": [
                *wrong_arrays(cells),
                *outside,
                ("one", cells[:1]),
                ("none", cells[:0]),
                ("three", np.zeros((3, 2), I8)),
            ],
        },
    )
    bits = np.zeros(terrain.shape, np.uint16)
    wrong_bits = [*wrong_arrays(bits), ("smaller", bits[:1])]
    space: Arguments = {**ground, "fits": bits, "steps": bits, "turns": bits}
    wrong_space = {
        **wrong_ground,
        **dict.fromkeys(("fits", "steps", "turns"), wrong_bits),
    }
    yield from variants(
        "drive",
        semmap_native.drive,
        {**space, "cells": cells, "targets": cells, "threads": 1},
        {
            **{k: iter(v) for k, v in wrong_space.items()},
            "cells": [*wrong_arrays(cells), *outside],
            "targets": [*[w for w in wrong_arrays(cells) if w[1] is not None], *outside],
            "threads": wrong_counts(0, 10_000),
        },
    )
    yield from variants(
        "drive_way",
        semmap_native.drive_way,
        {**space, "ends": cells},
        {
            **{k: iter(v) for k, v in wrong_space.items()},
            "ends": [*wrong_arrays(cells), *outside, ("one", cells[:1])],
        },
    )
    runs = np.array([[0, 0, -1, 1]], np.int32)
    yield from variants(
        "collisions",
        semmap_native.collisions,
        {"occupied": bits.astype(bool), "runs": runs},
        {
            "occupied": [
                *(w for w in wrong_arrays(bits.astype(bool)) if "column" not in w[0]),
                ("of numbers", bits),
            ],
            "runs": [
                *wrong_arrays(runs),
                ("of shape 16", runs + np.array([16, 0, 0, 0], np.int32)),
                ("upside down", runs[:, [0, 1, 3, 2]].copy()),
                ("too long", runs * np.array([1, 1, 40_000, 1], np.int32)),
                ("too far", runs + np.array([0, 70_000, 0, 0], np.int32)),
            ],
        },
    )
    yield from graph_calls()


def graph_calls() -> Iterator[tuple[str, Call]]:
    tails, heads, weights = np.array([0, 1], I8), np.array([1, 2], I8), np.array([1.0, 2.0])
    good: Arguments = {
        "tails": tails,
        "heads": heads,
        "weights": weights,
        "least": weights,
        "nodes": 3,
    }
    nodes = [
        ("beyond the nodes", tails + 2),
        ("below 0", tails - 1),
        ("one less", tails[:1]),
        ("one more", np.zeros(3, I8)),
        ("huge", tails + 2**62),
        ("of int32", tails.astype(I4)),
        ("of two dimensions", tails[None]),
        ("of 0 dimensions", np.array(0, I8)),
        ("unaligned", unaligned(tails)),
        ("None", None),
    ]
    costs = [
        ("negative", -weights),
        ("NaN", weights * NAN),
        ("one less", weights[:1]),
        ("one more", np.zeros(3)),
        ("none", weights[:0]),
        ("of two dimensions", weights[None]),
        ("unaligned", unaligned(weights)),
        ("None", None),
    ]
    yield from variants(
        "Graph",
        semmap_native.Graph,
        good,
        {
            "tails": nodes,
            "heads": nodes,
            "weights": costs,
            "least": costs,
            "nodes": wrong_counts(0, 2, 2**32 - 2, 2**27),
        },
    )
    graph = semmap_native.Graph(**good)
    yield from variants(
        "set_weights",
        graph.set_weights,
        {"edges": tails, "weights": weights},
        {
            "edges": nodes,
            "weights": costs,
        },
    )
    ends = [
        ("beyond the nodes", [(3, 0.0)]),
        ("below 0", [(-1, 0.0)]),
        ("negative", [(0, -1.0)]),
        ("NaN", [(0, NAN)]),
        ("huge", [(2**62, 0.0)]),
        ("numbers", [0]),
        ("None", None),
    ]
    pair: Arguments = {"sources": [(0, 0.0)], "targets": [(2, 0.0)]}
    yield from variants("shortest", graph.shortest, pair, {"sources": ends, "targets": ends})
    yield from variants(
        "alternatives",
        graph.alternatives,
        pair | {"count": 2},
        {
            "sources": ends,
            "targets": ends,
            "count": wrong_counts(),
        },
    )
    among = [case for case in nodes if case[0] not in ("one less", "one more")]
    yield from variants(
        "distances",
        graph.distances,
        {"sources": tails, "targets": heads, "threads": 1},
        {"sources": among, "targets": among, "threads": wrong_counts(0, 10_000)},
    )


def vdb_calls() -> Iterator[tuple[str, Call]]:
    """Of semmap_vdb."""
    vectors = [
        ("NaN", (NAN, 0, 0)),
        ("infinite", (INF, 0, 0)),
        ("huge", (HUGE, 0, 0)),
        ("of two numbers", (0, 0)),
        ("of four", (0, 0, 0, 0)),
        ("None", None),
    ]
    axes = [*vectors, ("zero", (0, 0, 0)), ("too long", (0, 0, 2)), ("tiny", (0, 0, 1e-200))]
    yield from variants(
        "ball",
        Shape.ball,
        {"center": (0, 0, 0), "radius": 1.0},
        {
            "center": vectors,
            "radius": wrong_numbers(0.0, -1.0),
        },
    )
    yield from variants(
        "cylinder",
        Shape.cylinder,
        {"center": (0, 0, 0), "axis": (0, 0, 1), "radius": 1.0, "height": 1.0},
        {
            "center": vectors,
            "axis": axes,
            "radius": wrong_numbers(0.0, -1.0),
            "height": wrong_numbers(-1.0),
        },
    )
    yield from variants(
        "cone",
        Shape.cone,
        {"apex": (0, 0, 0), "axis": (0, 0, 1), "half_angle": 0.5, "height": 1.0},
        {
            "apex": vectors,
            "axis": axes,
            "half_angle": wrong_numbers(0.0, -0.1, 1.6, 3.2),
            "height": wrong_numbers(0.0, -1.0),
        },
    )
    columns = [case for case in wrong_arrays(VERTICES) if case[0] not in ("unaligned",)]
    columns += [("NaN", VERTICES * NAN), ("infinite", VERTICES + INF)]
    unit = np.eye(3)
    yield from variants(
        "polytope",
        Shape.polytope,
        {"corners": VERTICES, "normals": unit, "edges": unit},
        {
            "corners": [*columns, ("none", np.zeros((0, 3)))],
            "normals": [*columns, ("no unit vectors", 2 * unit), ("zero", 0 * unit)],
            "edges": columns,
        },
    )
    yield from variants("points", Shape.points, {"points": VERTICES}, {"points": columns})
    faces = [
        ("None", None),
        ("of floats", VERTICES),
        ("flat", FACES.reshape(-1)),
        ("with a column less", FACES[:, :2]),
        ("below 0", FACES - 1),
        ("beyond the vertices", FACES + 1),
        ("huge", FACES + (2**31 - 4)),
        ("of large numbers", FACES.astype(I8) + 2**40),
    ]
    mesh: Arguments = {"vertices": VERTICES, "faces": FACES}
    open_ = [("open", FACES[:3])]
    yield from variants("solid", Shape.solid, mesh, {"vertices": columns, "faces": faces + open_})
    yield from variants("surface", Shape.surface, mesh, {"vertices": columns, "faces": faces})
    poses = [
        ("NaN", [[NAN] * 4] * 3),
        ("of two rows", UNMOVED[:2]),
        ("of three columns", [[0] * 3] * 3),
        ("infinite", [[INF] * 4] * 3),
        ("None", None),
    ]
    cameras = [
        ("NaN", (NAN, 1, 1, 1)),
        ("of three", (1, 1, 1)),
        ("zero", (0, 1, 1, 1)),
        ("negative", (1, -1, 1, 1)),
        ("infinite", (1, 1, INF, 1)),
        ("None", None),
    ]
    images = [
        ("of one dimension", DEPTH[0]),
        ("of three", DEPTH[None]),
        ("of text", [["a"]]),
        ("of 0 dimensions", np.float32(1)),
    ]
    view: Arguments = {"depth": DEPTH, "intrinsics": CAMERA, "pose": UNMOVED, "farthest": 9.0}
    yield from variants(
        "depth_image",
        Shape.depth_image,
        view | {"mask": None},
        {
            "depth": images,
            "intrinsics": cameras,
            "pose": poses,
            "farthest": [("text", "far")],
            "mask": [
                ("smaller", np.ones((3, 5), bool)),
                ("flat", np.ones(20, bool)),
                ("none", np.ones((0, 0), bool)),
            ],
        },
    )
    yield from variants(
        "of_labels",
        Int32Grid.of_labels,
        view | {"labels": np.ones((4, 5), I4), "voxel_size": 0.1},
        {
            "depth": images,
            "intrinsics": cameras,
            "pose": poses,
            "labels": [
                ("smaller", np.ones((3, 5), I4)),
                ("flat", np.ones(20, I4)),
                ("None", None),
                ("of floats", np.ones((4, 5))),
            ],
            "voxel_size": wrong_numbers(0.0, -1.0, 1e-200),
        },
    )
    sizes = list(wrong_numbers(0.0, -1.0, 1e-200))
    yield from variants("voxels", Shape.ball((0, 0, 0), 1).voxels, {}, {"voxel_size": sizes})
    yield "voxels: too many", lambda: Shape.ball((0, 0, 0), 100).voxels(0.05)
    yield "voxels: too many to list", lambda: Shape.ball((0, 0, 0), 18).voxels(0.05)
    yield from variants(
        "limit_regions",
        semmap_vdb.limit_regions,
        {"voxels": 2**30, "blocks": 2**18},
        {
            "voxels": [("0", 0), ("-1", -1), ("2^40", 2**40)],
            "blocks": [("0", 0), ("-1", -1), ("2^40", 2**40)],
        },
    )
    yield from variants(
        "choose_variant",
        semmap_vdb.choose_variant,
        {},
        {
            "name": [("unknown", "neon"), ("empty", ""), ("None", None)],
        },
    )
    yield from region_map_calls()
    for kind, background, dtype in (
        (BoolGrid, False, np.bool_),
        (Int32Grid, 0, I4),
        (FloatGrid, 0.0, np.float32),
    ):
        yield from grid_calls(kind, background, dtype)


def region_map_calls() -> Iterator[tuple[str, Call]]:
    ball = Shape.ball((0, 0, 0), 0.5)
    regions = RegionMap(0.1)
    regions.insert(0, ball)
    entities = list(wrong_counts(2**22))
    yield from variants("RegionMap", RegionMap, {}, {"voxel_size": wrong_numbers(0.0, -1.0)})
    for name in ("insert", "move"):
        yield from variants(
            name,
            getattr(regions, name),
            {"entity": 0, "shape": ball},
            {
                "entity": entities,
                "shape": [("None", None), ("a number", 1)],
            },
        )
    yield from variants(
        "insert_many",
        regions.insert_many,
        {"entities": [0, 1], "shapes": [ball, ball], "threads": 1},
        {
            "entities": [
                ("one less", [0]),
                ("none", []),
                ("negative", [-1, 0]),
                ("huge", [2**31 - 1, 0]),
                ("beyond int32", [2**31, 0]),
            ],
            "shapes": [("of None", [None, None]), ("one less", [ball]), ("numbers", [1, 2])],
            "threads": wrong_counts(0, 10_000),
        },
    )
    yield from variants(
        "set_numbers_at",
        regions.set_numbers_at,
        {"points": POINTS},
        {
            "points": [case for case in wrong_arrays(POINTS) if case[0] != "unaligned"]
            + [("NaN", POINTS * NAN), ("huge", POINTS + HUGE)],
        },
    )
    yield from variants(
        "neighbours",
        regions.neighbours,
        {"entity": 0, "farthest": 0},
        {
            "farthest": [case for case in wrong_counts(-2) if case[0] != "-1"],
        },
    )
    yield "write: no folder", lambda: regions.write("/nowhere/at/all.vdb")
    grid, sets = regions.state()
    for text, wrong in (
        ("a set of no number", [(0, [0])]),
        ("a negative set", [(-1, [0])]),
        ("a huge set", [(2**31 - 1, [0])]),
        ("an empty set", [(1, [])]),
        ("a negative entity", [(1, [-1])]),
        ("a huge entity", [(1, [2**31 - 1])]),
        ("a set twice", [*sets, *sets]),
        ("a set of no voxel", [*sets, (7, [3])]),
        ("entities out of order", [(1, [5, 3])]),
        ("no set", []),
    ):
        yield f"restore: {text}", lambda wrong=wrong: RegionMap(0.1).restore(grid, wrong)  # type: ignore[misc]
    yield "restore: twice", lambda: regions.restore(grid, sets)
    yield "restore: another voxel size", lambda: RegionMap(0.2).restore(grid, sets)
    yield "restore: None", lambda: RegionMap(0.1).restore(None, sets)  # type: ignore[arg-type]
    yield (
        "restore: a world of one set",
        lambda: RegionMap(0.1).restore(whole(Int32Grid(0.1, 0), 1, 40), [(1, [0])]),
    )


def whole(grid: Any, value: Any, cubes: int) -> Any:
    """A grid with `cubes`^3 cubes of 128^3 voxels, of ten bytes each."""
    (cube,) = one_cube(type(grid), value).values()
    places = ((x, y, z) for x in range(cubes) for y in range(cubes) for z in range(cubes))
    grid.put_blocks({(128 * x, 128 * y, 128 * z): cube for x, y, z in places}, 128)
    return grid


def one_cube(kind: Any, value: Any) -> dict[Any, bytes]:
    grid = kind(1.0, type(value)(0))
    corners = np.array([(x, y, z) for x in (0, 128) for y in (0, 128) for z in (0, 128)], F)
    grid.fill(Shape.polytope(corners, np.concatenate([np.eye(3), -np.eye(3)]), np.eye(3)), value)
    cubes: dict[Any, bytes] = grid.blocks(128)
    return cubes


def grid_calls(kind: Any, background: Any, dtype: Any) -> Iterator[tuple[str, Call]]:
    name = kind.__name__
    one = dtype(1).item()
    grid = kind(0.1, background)
    grid.fill(Shape.ball((0, 0, 0), 0.5), one)
    voxels, values = grid.read()
    yield from variants(
        name,
        kind,
        {"voxel_size": 0.1, "background": background},
        {
            "voxel_size": wrong_numbers(0.0, -1.0, 1e-200),
            "background": [("a list", [1])]
            if kind is BoolGrid
            else [("text", "a"), ("None", None)],
        },
    )
    placements = [
        ("NaN", [[NAN] * 4] * 3),
        ("not a rotation", [[2.0, 0, 0, 0], *UNMOVED[1:]]),
        ("singular", [[0.0] * 4] * 3),
        ("infinite shift", [[1.0, 0, 0, INF], *UNMOVED[1:]]),
        ("of two rows", UNMOVED[:2]),
        ("None", None),
    ]
    yield from variants(f"{name}.place", grid.place, {}, {"placement": placements})
    yield from variants(f"{name}.placed", grid.placed, {}, {"placement": placements})
    yield from variants(
        f"{name}.resampled",
        grid.resampled,
        {"voxel_size": 0.1, "placement": UNMOVED},
        {
            "placement": placements,
            "voxel_size": wrong_numbers(0.0, -1.0, 1e-200, 1e-6),
        },
    )
    giant = Shape.ball((0, 0, 0), 1000.0)
    for method in ("fill", "clear"):
        good = {"value": one} if method == "fill" else {}
        yield from variants(
            f"{name}.{method}",
            getattr(grid, method),
            good,
            {
                "shape": [("None", None), ("too large", giant)],
            },
        )
    yield from variants(
        f"{name}.set",
        grid.set,
        {"voxels": voxels, "values": values},
        {
            "voxels": [
                *[c for c in wrong_arrays(voxels) if c[0] != "unaligned"],
                ("one less", voxels[1:]),
                ("far away", voxels + (2**31 - 100)),
                (
                    "too far apart",
                    (np.arange(len(voxels) * 3, dtype=I4) * 1_300_000).reshape(-1, 3),
                ),
            ],
            "values": [
                ("one less", values[1:]),
                ("none", values[:0]),
                ("of two dimensions", values[None]),
            ],
        },
    )
    yield from variants(
        f"{name}.at",
        grid.at,
        {},
        {
            "points": [
                *[c for c in wrong_arrays(POINTS) if c[0] != "unaligned"],
                ("NaN", POINTS * NAN),
                ("huge", POINTS + HUGE),
            ],
        },
    )
    boxes = [
        ("negative", (-1, 1, 1)),
        ("huge", (2**31 - 1, 1, 1)),
        ("of too many voxels", (2**20,) * 3),
        ("whose product overflows", (2**30,) * 3),
        ("of two", (1, 1)),
        ("beyond int32", (2**31, 1, 1)),
    ]
    yield from variants(
        f"{name}.read_box",
        grid.read_box,
        {"low": (0, 0, 0), "shape": (2, 2, 2)},
        {
            "shape": boxes,
            "low": [("far", (2**31 - 1, 0, 0)), ("of two", (0, 0)), ("text", "abc")],
        },
    )
    other = kind(0.2, background)
    yield f"{name}.joined: another lattice", lambda: grid.joined(other, "max")
    yield f"{name}.joined: unknown", lambda: grid.joined(grid, "mean")
    yield f"{name}.joined: None", lambda: grid.joined(None, "max")
    yield f"{name}.masked: another lattice", lambda: grid.masked(BoolGrid(0.2, False), True)
    yield f"{name}.cropped: of two", lambda: grid.cropped((0, 0), (1, 1))
    yield f"{name}.write: no folder", lambda: grid.write("/nowhere/at/all.vdb", "name")
    for edge in (-1, 0, 1, 7, 9, 256, 2**31 - 1, 2**40):
        yield f"{name}.blocks: an edge of {edge}", lambda edge=edge: grid.blocks(edge)  # type: ignore[misc]
    (good_cube, *_) = grid.blocks(8).values()
    for text, cubes in (
        ("no bytes", {(0, 0, 0): b""}),
        ("another format", {(0, 0, 0): b"\x02"}),
        ("cut off", {(0, 0, 0): good_cube[:-1]}),
        ("noise", {(0, 0, 0): b"\x01" + bytes(range(99))}),
        ("an unknown kind", {(0, 0, 0): b"\x01\x09\x00\x00"}),
        ("off the edge", {(1, 0, 0): good_cube}),
        ("far away", {(-(2**31), 0, 0): good_cube}),
        ("beyond int32", {(2**31, 0, 0): good_cube}),
        ("too far apart", {(4096 * 128 * i, 0, 0): good_cube for i in range(-2047, 2047)}),
        ("a number", {(0, 0, 0): 1}),
    ):
        yield (
            f"{name}.put_blocks: {text}",
            lambda cubes=cubes: kind(0.1, background).put_blocks(cubes, 8),
        )  # type: ignore[misc]
    world = whole(kind(0.1, background), one, 11)
    yield f"{name}.read: too many", world.read
    yield f"{name}.active: too many", world.active
    yield f"{name}.joined: too many", lambda: world.joined(world, "max")
