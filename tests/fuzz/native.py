"""Every function of the native modules, called directly: dtypes, strides, shapes, numbers, threads.

A case is JSON: an object to make, if any, and calls with descriptions of their arguments.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import semmap_native
import semmap_vdb
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid, RegionMap, Shape
from tests.fuzz.kind import Kind
from tests.oracles.region_map import check_region_map

Spec = Any
"""An argument as JSON: a number, a text, a list, or a mapping that `made` knows."""

Arguments = dict[str, Spec]
Good = Callable[[Random], Arguments]

REFUSED = (ValueError, TypeError, OSError)

ODD_FLOATS = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-310",
    "0.0",
    "-0.0",
    "1e30",
    "1e31",
    "-1.0",
    "1e-9",
)
ODD_INTS = (
    0,
    -1,
    1,
    2,
    7,
    255,
    256,
    1000,
    2**25,
    2**31 - 1,
    2**31,
    -(2**31),
    2**32,
    2**53,
    2**62,
    2**63 - 1,
    2**63,
    2**64,
    -(2**63),
)
DTYPES = ("f8", "f4", "i4", "i8", "u1", "?", "u4", "i2", "c16", "O", "U3", ">f8", ">i4", "M8[s]")
LAYOUTS = ("c", "c", "c", "f", "strided", "reversed", "unaligned", "broadcast", "readonly", "empty")


# -- arguments -----------------------------------------------------------------------------------


def array(random: Random, dtype: str, *shape: int, low: float = 0, high: float = 1) -> Spec:
    """A description of an array of random numbers."""
    return {
        "array": dtype,
        "shape": list(shape),
        "low": low,
        "high": high,
        "seed": random.randrange(2**32),
    }


def made(spec: Spec) -> Any:
    """The argument that a description means."""
    if isinstance(spec, list):
        return [made(each) for each in spec]
    if not isinstance(spec, dict):
        return spec
    if "float" in spec:
        return float(spec["float"])
    if "pairs" in spec:
        return [(made(a), made(b)) for a, b in spec["pairs"]]
    if "tuple" in spec:
        return tuple(made(each) for each in spec["tuple"])
    if "shape_of" in spec:
        return SHAPES[spec["shape_of"]][0](**{k: made(v) for k, v in spec["args"].items()})
    if "grid" in spec:
        return _grid(spec["grid"], spec["seed"])
    if "bytes" in spec:
        return {tuple(at): bytes.fromhex(text) for at, text in spec["bytes"]}
    return _array(spec)


def _array(spec: Spec) -> np.ndarray[Any, Any]:
    random = np.random.default_rng(spec["seed"])
    shape, dtype = tuple(spec["shape"]), np.dtype(spec["array"])
    if dtype.kind in "iu":
        values = random.integers(
            int(spec["low"]), max(int(spec["high"]), int(spec["low"]) + 1), shape
        )
    elif dtype.kind == "b":
        values = random.integers(0, 2, shape)
    else:
        values = random.uniform(spec["low"], spec["high"], shape)
    for at, text in spec.get("odd", ()):
        if values.size:
            values = values.astype(float)
            values.reshape(-1)[at % values.size] = float(text)
    with np.errstate(all="ignore"):
        if dtype.kind == "i":
            values = np.nan_to_num(values, nan=-1).clip(-(2.0**62), 2.0**62)
        found = np.ascontiguousarray(values.astype(dtype))
    return _laid(found, spec.get("layout", "c"))


def _laid(found: np.ndarray[Any, Any], layout: str) -> np.ndarray[Any, Any]:
    """The same numbers otherwise in memory."""
    match layout:
        case "f":
            return np.asfortranarray(found)
        case "strided" if found.ndim:
            return np.repeat(found, 2, axis=0)[::2]
        case "reversed" if found.ndim:
            return found[::-1]
        case "unaligned" if found.dtype.kind not in "OU":
            raw = np.zeros(found.nbytes + 1, np.uint8)
            other = raw[1:].view(found.dtype).reshape(found.shape)
            other[...] = found
            return other
        case "broadcast" if found.ndim and len(found):
            return np.broadcast_to(found[:1], found.shape)
        case "readonly":
            found.flags.writeable = False
        case "empty" if found.ndim:
            return found[:0]
    return found


@cache  # a hundred grids as the arguments of one call would count as its memory
def _grid(name: str, seed: int) -> Any:
    kind: Any = {"BoolGrid": BoolGrid, "Int32Grid": Int32Grid, "FloatGrid": FloatGrid}[name]
    grid = kind(0.1, kind is FloatGrid and 0.0)
    grid.fill(Shape.ball((0, 0, 0), 0.1 * (seed % 9 + 1)), 1)
    return grid


def odd(random: Random, good: Spec) -> Spec:
    """Something else than a good argument, or nearly the same."""
    if isinstance(good, dict) and "array" in good and random.random() < 0.8:
        changed = dict(good)
        for _ in range(random.choice((1, 1, 2))):
            match random.randrange(6):
                case 0:
                    changed["array"] = random.choice(DTYPES)
                case 1:
                    changed["shape"] = [
                        random.choice((0, 1, 2, 3, 4, 5, 17, 64))
                        for _ in range(random.choice((0, 1, 2, 2, 2, 3, 4)))
                    ]
                case 2:
                    changed["layout"] = random.choice(LAYOUTS)
                case 3:
                    changed["odd"] = [
                        (random.randrange(999), random.choice(ODD_FLOATS)) for _ in range(3)
                    ]
                case 4:
                    changed["low"], changed["high"] = random.choice(
                        ((-5, 5), (0, 2**40), (-1e300, 1e300))
                    )
                case _:
                    shape = list(changed["shape"])
                    if shape:
                        at = random.randrange(len(shape))
                        shape[at] = max(0, shape[at] + random.choice((-1, 1)))
                    changed["shape"] = shape
        return changed
    if isinstance(good, dict) and "pairs" in good and random.random() < 0.7:
        return {
            "pairs": [[odd(random, a), odd(random, b)] for a, b in good["pairs"]]
            * random.choice((0, 1, 40))
        }
    if isinstance(good, dict) and "tuple" in good and random.random() < 0.7:
        return {
            "tuple": [odd(random, v) if random.random() < 0.4 else v for v in good["tuple"]]
            * random.choice((1, 1, 2))
        }
    if isinstance(good, dict) and "args" in good and random.random() < 0.7:
        return {**good, "args": mutated(random, good["args"])}
    if isinstance(good, list) and random.random() < 0.6:
        return [odd(random, each) for each in good] * random.choice((0, 1, 1, 2))
    return random.choice(
        (
            {"float": random.choice(ODD_FLOATS)},
            random.choice(ODD_INTS),
            random.choice(ODD_INTS),
            random.choice((None, True, "", "text", [], [[]], {"tuple": []}, {"pairs": []})),
            {
                "grid": random.choice(("BoolGrid", "Int32Grid", "FloatGrid")),
                "seed": random.randrange(9),
            },
            array(random, random.choice(DTYPES[:6]), random.choice((0, 1, 3, 17)), 3),
        )
    )


def mutated(random: Random, good: Arguments) -> Arguments:
    """Some of the arguments changed."""
    changed = dict(good)
    for name in random.sample(list(good), min(len(good), random.choice((0, 1, 1, 1, 2, 3)))):
        changed[name] = odd(random, good[name])
    return changed


# -- semmap_native -------------------------------------------------------------------------------


def mesh(random: Random) -> Arguments:
    vertices, faces = random.choice((0, 3, 4, 40)), random.choice((0, 1, 4, 60))
    faces = faces if vertices else 0
    solids = random.choice((None, None, array(random, "i4", faces, high=3)))
    return {
        "vertices": array(random, "f8", vertices, 3, low=-2, high=5),
        "faces": array(random, random.choice(("i4", "i8")), faces, 3, high=vertices),
        "solids": solids,
        "solid_count": 1 if solids is None else 3,
        "threads": random.choice((1, 1, 2, 5)),
    }


def drawing(random: Random) -> Arguments:
    ends = [
        [random.uniform(-2, 2), random.uniform(2, 5)]
        for _ in range(random.choice((0, 1, 2, 9, 40)))
    ]
    found = mesh(random) | {
        "intervals": {"pairs": ends},
        "origin_x": random.uniform(-3, 3),
        "origin_y": random.uniform(-3, 3),
        "resolution": random.choice((0.05, 0.3, 7.0)),
        "rows": random.choice((0, 1, 20, 90)),
        "columns": random.choice((0, 1, 20, 90)),
        "fill": random.random() < 0.5,
        "filled": None,
    }
    if found["solids"] is not None and random.random() < 0.5:
        found["filled"] = array(random, "?", 3)
    return found


def inflating(random: Random) -> Arguments:
    radius = random.choice((0, 1, 5, 11, 12, 40, 181, 182, 300))
    return {
        "occupied": array(
            random, "?", random.choice((0, 1, 30, 150)), random.choice((0, 1, 30, 1100))
        ),
        "radius": radius,
        "costs": array(random, "u1", radius**2 + 1, high=255),
        "variant": random.choice((None, None, "baseline", *semmap_native.inflation_variants())),
    }


def travelling(random: Random) -> Arguments:
    rows, columns = random.choice((1, 5, 40)), random.choice((1, 5, 40))
    count = random.choice((0, 1, 5))
    cells = array(random, "i8", count, 2, high=min(rows, columns))
    return {
        "costs": array(random, "u1", rows, columns, high=random.choice((1, 256))),
        "resolution": 0.05,
        "cells": cells,
        "slow": random.choice((0.0, 1.0, 900.0)),
        "targets": random.choice((None, array(random, "i8", 3, 2, high=min(rows, columns)))),
        "threads": random.choice((1, 2, 4)),
    }


def way(random: Random) -> Arguments:
    found = travelling(random)
    rows, columns = found["costs"]["shape"]
    return {key: found[key] for key in ("costs", "resolution", "slow")} | {
        "ends": array(random, "i8", 2, 2, high=min(rows, columns))
    }


def driving(random: Random) -> Arguments:
    found = travelling(random)
    rows, columns = found["costs"]["shape"]
    bits = {
        key: array(random, "u2", rows, columns, high=random.choice((1, 65536)))
        for key in ("fits", "steps", "turns")
    }
    targets = array(random, "i8", 3, 2, high=min(rows, columns))
    return found | bits | {"targets": targets}


def drive_way(random: Random) -> Arguments:
    found = driving(random)
    rows, columns = found["costs"]["shape"]
    ends = array(random, "i8", 2, 2, high=min(rows, columns))
    left_out = ("cells", "targets", "threads")
    return {key: value for key, value in found.items() if key not in left_out} | {"ends": ends}


def colliding(random: Random) -> Arguments:
    rows, columns, count = (random.choice((1, 5, 70)) for _ in range(3))
    return {
        "occupied": array(random, "?", rows, columns, high=2),
        "runs": array(random, "i4", count, 4, low=0, high=random.choice((1, 2, 17))),
    }


BOUNDS = {"sphere": 1, "cylinder": 3, "cone": 3, "cuboid": 6}
ROTATIONS = (
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]],
)


def placed_shape(random: Random) -> Arguments:
    kind = random.choice(list(BOUNDS))
    low = random.choice((-1, 0.1))
    return {
        "kind": kind,
        "rotation": random.choice(ROTATIONS),
        "origin": array(random, "f8", 3, low=-1),
        "bounds": array(random, "f8", BOUNDS[kind], low=low, high=random.choice((low, 1, 100))),
    }


def distances(random: Random) -> Arguments:
    return placed_shape(random) | {
        "points": array(random, "f8", random.choice((0, 1, 90)), 3, low=-1)
    }


def surfels(random: Random) -> Arguments:
    count, width = random.choice((1, 2, 90, 400)), random.choice((0.0, 1e-9, 1.0, 1e6))
    return placed_shape(random) | {
        "points": array(random, "f8", count, 3, low=-width, high=width),
        "normals": array(random, "f8", count, 3, low=-1),
    }


def costs(random: Random) -> Arguments:
    return surfels(random) | {"tolerance": random.choice((1e-30, 0.01, 1e30))}


def fitting(random: Random) -> Arguments:
    plane = {"tuple": [{"tuple": [0.0, 0.6, 0.8]}, random.uniform(-2, 2)]}
    return surfels(random) | {
        "whole": array(random, "f8", random.choice((1, 30, 900)), 3, low=-1),
        "spacing": random.choice((0.0, 0.01, 1e6)),
        "noise": random.choice((1e-30, 1e-3, 0.1, 1e30)),
        "table": random.choice((None, plane)),
        "turns": random.choice((1, 2, 16)),
    }


def neighbours(random: Random) -> Arguments:
    count, width = random.choice((1, 20)), random.choice((0.0, 1e-200, 1.0, 1e6))
    return {
        "points": array(random, "f8", count, 3, low=-width, high=width),
        "near": array(random, "i8", random.choice((0, 1, 9)), random.choice((1, 5)), high=count),
    }


FUNCTIONS: dict[str, tuple[Callable[..., Any], Good]] = {
    "closed_solids": (semmap_native.closed_solids, mesh),
    "occupancy": (semmap_native.occupancy, drawing),
    "inflate": (semmap_native.inflate, inflating),
    "travel": (semmap_native.travel, travelling),
    "way": (semmap_native.way, way),
    "drive": (semmap_native.drive, driving),
    "drive_way": (semmap_native.drive_way, drive_way),
    "collisions": (semmap_native.collisions, colliding),
    "shape_distances": (semmap_native.shape_distances, distances),
    "shape_cost": (semmap_native.shape_cost, costs),
    "fit_shape": (semmap_native.fit_shape, fitting),
    "local_planes": (semmap_native.local_planes, neighbours),
}

EDGES, NODES = 30, 12


def graph(random: Random) -> Arguments:
    weights = array(random, "f8", EDGES, high=9)
    return {
        "tails": array(random, "i8", EDGES, high=NODES),
        "heads": array(random, "i8", EDGES, high=NODES),
        "weights": weights,
        "least": weights,
        "nodes": NODES,
    }


def ends(random: Random) -> Spec:
    return {
        "pairs": [
            [random.randrange(NODES), random.uniform(0, 3)] for _ in range(random.choice((1, 3)))
        ]
    }


def some_edges(random: Random) -> Arguments:
    count = random.choice((0, 1, 9))
    return {
        "edges": array(random, "i8", count, high=EDGES),
        "weights": array(random, "f8", count, high=20),
    }


GRAPH_STEPS: dict[str, Good] = {
    "prepare": lambda random: {},
    "weights": lambda random: {},
    "set_weights": some_edges,
    "shortest": lambda random: {"sources": ends(random), "targets": ends(random)},
    "alternatives": lambda random: {
        "sources": ends(random),
        "targets": ends(random),
        "count": random.choice((0, 1, 5)),
    },
    "distances": lambda random: {
        "sources": array(random, "i8", 4, high=NODES),
        "targets": array(random, "i8", 3, high=NODES),
        "threads": random.choice((1, 2)),
    },
}


# -- semmap_vdb ----------------------------------------------------------------------------------


def vector(random: Random, reach: float = 2) -> Spec:
    return {"tuple": [random.uniform(-reach, reach) for _ in range(3)]}


def axis(random: Random) -> Spec:
    return {"tuple": random.choice(([0, 0, 1], [0, 1, 0], [0.6, 0.8, 0], [0, -0.6, 0.8]))}


def polytope(random: Random) -> Arguments:
    low, high = random.uniform(-2, 0), random.uniform(0, 2)
    return {
        "corners": [[x, y, z] for x in (low, high) for y in (low, high) for z in (low, high)],
        "normals": [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]],
        "edges": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    }


def tetrahedron(random: Random) -> Arguments:
    size = random.choice((0.01, 0.5, 3.0))
    return {
        "vertices": [[0, 0, 0], [size, 0, 0], [0, size, 0], [0, 0, size]],
        "faces": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    }


def soup(random: Random) -> Arguments:
    return {
        "vertices": array(random, "f8", 9, 3, low=-2, high=2),
        "faces": array(random, "i4", random.choice((0, 1, 9)), 3, high=9),
    }


POSE = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0.5]]


def depth(random: Random) -> Arguments:
    return {
        "depth": array(random, "f4", 6, 8, low=-1, high=4),
        "mask": random.choice((None, array(random, "?", 6, 8))),
        "intrinsics": {"tuple": [8.0, 8.0, 3.5, 2.5]},
        "pose": POSE,
        "farthest": random.choice((3.0, 1e9)),
    }


SHAPES: dict[str, tuple[Callable[..., Shape], Good]] = {
    "ball": (Shape.ball, lambda r: {"center": vector(r), "radius": r.uniform(0.01, 2)}),
    "cylinder": (
        Shape.cylinder,
        lambda r: {
            "center": vector(r),
            "axis": axis(r),
            "radius": r.uniform(0.01, 2),
            "height": r.uniform(0, 3),
        },
    ),
    "cone": (
        Shape.cone,
        lambda r: {
            "apex": vector(r),
            "axis": axis(r),
            "half_angle": r.uniform(0.1, 1.4),
            "height": r.uniform(0.1, 1),
        },
    ),
    "polytope": (Shape.polytope, polytope),
    "points": (
        Shape.points,
        lambda r: {"points": array(r, "f8", r.choice((0, 1, 30)), 3, low=-3, high=3)},
    ),
    "solid": (Shape.solid, tetrahedron),
    "surface": (Shape.surface, soup),
    "depth_image": (Shape.depth_image, depth),
}


def shape(random: Random) -> Spec:
    name = random.choice(list(SHAPES))
    return {"shape_of": name, "args": SHAPES[name][1](random)}


def entity(random: Random) -> int:
    return random.randrange(5)


REGION_STEPS: dict[str, Good] = {
    "insert": lambda r: {"entity": entity(r), "shape": shape(r)},
    "move": lambda r: {"entity": entity(r), "shape": shape(r)},
    "remove": lambda r: {"entity": entity(r)},
    "insert_many": lambda r: {
        "entities": [entity(r), entity(r)],
        "shapes": [shape(r), shape(r)],
        "threads": r.choice((1, 2)),
        "others": r.random() < 0.5,
    },
    "set_numbers_at": lambda r: {"points": array(r, "f8", 9, 3, low=-3, high=3)},
    "members": lambda r: {"numbers": [r.randrange(9) for _ in range(4)]},
    "voxels": lambda r: {"entity": entity(r)},
    "size": lambda r: {"entity": entity(r)},
    "has": lambda r: {"entity": entity(r)},
    "overlap": lambda r: {"a": entity(r), "b": entity(r)},
    "neighbours": lambda r: {"entity": entity(r), "farthest": r.choice((-1, 0, 9, 400))},
    "support": lambda r: {"a": entity(r), "b": entity(r)},
    "memory": lambda r: {},
    "state": lambda r: {},
}

LISTED = 1 << 22
"""Voxels from which on a region map is not checked: the oracle lists all of them."""

VALUES = {"BoolGrid": "?", "Int32Grid": "i4", "FloatGrid": "f4"}


def grid_steps(kind: str) -> dict[str, Good]:
    value = {"BoolGrid": True, "Int32Grid": 3, "FloatGrid": 0.5}[kind]
    found: dict[str, Good] = {
        "fill": lambda r: {"shape": shape(r), "value": value},
        "clear": lambda r: {"shape": shape(r)},
        "set": lambda r: {
            "voxels": array(r, "i4", 9, 3, low=-20, high=20),
            "values": array(r, VALUES[kind], 9),
        },
        "at": lambda r: {"points": array(r, "f8", 9, 3, low=-3, high=3)},
        "read": lambda r: {},
        "read_box": lambda r: {"low": {"tuple": [-3, -3, -3]}, "shape": {"tuple": [6, 6, 6]}},
        "joined": lambda r: {
            "other": {"grid": kind, "seed": r.randrange(9)},
            "how": r.choice(("first", "last", "max", "min", "sum")),
        },
        "masked": lambda r: {
            "mask": {"grid": "BoolGrid", "seed": r.randrange(9)},
            "inside": r.random() < 0.5,
        },
        "active": lambda r: {},
        "between": lambda r: {"low": value, "high": value},
        "cropped": lambda r: {"low": {"tuple": [-3, -3, -3]}, "high": {"tuple": [6, 6, 6]}},
        "bounds": lambda r: {},
        "resampled": lambda r: {"voxel_size": r.choice((0.05, 0.1, 0.3)), "placement": POSE},
        "placed": lambda r: {"placement": POSE},
        "place": lambda r: {"placement": r.choice((POSE, [[*row[:3], 0.0] for row in POSE]))},
        "prune": lambda r: {},
        "blocks": lambda r: {"edge": r.choice((8, 16, 32, 64, 128))},
        "put_blocks": lambda r: {"blocks": cubes(r), "edge": r.choice((8, 32, 128))},
    }
    if kind == "Int32Grid":
        found["renumbered"] = lambda r: {"pairs": {"pairs": [[3, 4], [r.randrange(9), 1]]}}
        found["of_labels"] = lambda r: {
            **{key: arg for key, arg in depth(r).items() if key != "mask"},
            "labels": array(r, "i4", 6, 8, high=4),
            "voxel_size": 0.1,
        }
    return found


def cubes(random: Random) -> Spec:
    """Cubes of a grid with some of their bytes changed."""
    grid = FloatGrid(0.1, 0.0)
    grid.fill(Shape.ball((0, 0, 0), random.uniform(0.1, 2)), 0.5)
    found = []
    for at, data in list(grid.blocks(random.choice((8, 32, 128))).items())[:4]:
        changed = bytearray(data)
        for _ in range(random.choice((0, 1, 3))):
            changed[random.randrange(len(changed))] = random.randrange(256)
        del changed[
            random.choice((len(changed), len(changed), random.randrange(len(changed) + 1))) :
        ]
        place = (
            [*at]
            if random.random() < 0.8
            else [random.choice((0, 128, 2**30, -(2**31), 5)) for _ in at]
        )
        found.append([place, changed.hex()])
    return {"bytes": found}


# -- cases ---------------------------------------------------------------------------------------


def call_of(functions: dict[str, Any], random: Random, good: Callable[[str], Good]) -> Spec:
    name = random.choice(list(functions))
    return {"call": name, "args": mutated(random, good(name)(random))}


def function_case(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    return json.dumps(call_of(FUNCTIONS, random, lambda name: FUNCTIONS[name][1])).encode()


def run_function(data: bytes, _: Path) -> None:
    case = json.loads(data)
    FUNCTIONS[case["call"]][0](**{key: made(spec) for key, spec in case["args"].items()})


def shape_case(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    case = call_of(SHAPES, random, lambda name: SHAPES[name][1])
    size = random.choice((0.02, 0.1, 0.1, 1.0, odd(random, 0.1)))
    return json.dumps({**case, "voxel_size": size}).encode()


def run_shape(data: bytes, _: Path) -> None:
    case = json.loads(data)
    made_ = SHAPES[case["call"]][0](**{key: made(spec) for key, spec in case["args"].items()})
    voxels = made_.voxels(made(case["voxel_size"]))
    if len(voxels) < 100_000:  # sorting rows takes NumPy longer than finding the voxels
        assert len(np.unique(voxels, axis=0)) == len(voxels)


def steps_case(
    init: Good, steps: dict[str, Good], threaded: bool
) -> Callable[[Random, bytes, Sequence[bytes]], bytes]:
    def case(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
        first = init(random)
        if random.random() < 0.2:
            first = mutated(random, first)
        calls = [
            call_of(steps, random, steps.__getitem__) for _ in range(random.choice((1, 4, 12)))
        ]
        threads = random.choice((1, 1, 3)) if threaded else 1
        return json.dumps({"init": first, "steps": calls, "threads": threads}).encode()

    return case


def run_steps(make: Callable[..., Any]) -> Callable[[bytes, Path], None]:
    def run(data: bytes, _: Path) -> None:
        case = json.loads(data)
        target = make(**{key: made(spec) for key, spec in case["init"].items()})
        failed: list[BaseException] = []
        refused: list[BaseException] = []

        def work() -> None:
            for step in case["steps"]:
                try:
                    getattr(target, step["call"])(**{k: made(v) for k, v in step["args"].items()})
                except REFUSED as error:
                    refused.append(error)
                except BaseException as error:
                    failed.append(error)

        others = [threading.Thread(target=work) for _ in range(case["threads"] - 1)]
        for other in others:
            other.start()
        work()
        for other in others:
            other.join()
        if failed:
            raise failed[0]
        if isinstance(target, RegionMap) and target.memory()[3] < LISTED:
            check_region_map(target)
        if refused:
            raise refused[0]

    return run


def seeds() -> list[bytes]:
    return [b"{}"]


def _steps(
    name: str, make: Callable[..., Any], init: Good, steps: dict[str, Good], threaded: bool = False
) -> Kind:
    return Kind(name, seeds, [steps_case(init, steps, threaded)], run_steps(make), REFUSED, False)


def grid_init(kind: str) -> Good:
    return lambda r: {
        "voxel_size": 0.1,
        "background": {"BoolGrid": False, "Int32Grid": 0, "FloatGrid": 0.0}[kind],
    }


NATIVE_KINDS = [
    Kind("native functions", seeds, [function_case], run_function, REFUSED, False),
    Kind("native shapes", seeds, [shape_case], run_shape, REFUSED, False),
    _steps("native Graph", semmap_native.Graph, graph, GRAPH_STEPS, True),
    _steps("native RegionMap", RegionMap, lambda r: {"voxel_size": 0.1}, REGION_STEPS, True),
    *(
        _steps(f"native {kind}", getattr(semmap_vdb, kind), grid_init(kind), grid_steps(kind))
        for kind in VALUES
    ),
]
