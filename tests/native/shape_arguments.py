"""Calls of the native functions on shapes with arguments that they cannot take."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import semmap_native
from tests.native.arguments import (
    HUGE,
    I8,
    INF,
    NAN,
    Arguments,
    Call,
    variants,
    wrong_arrays,
    wrong_counts,
    wrong_numbers,
)


def shape_calls() -> Iterator[tuple[str, Call]]:
    """Of the functions of semmap_native that fit shapes to points."""
    points = np.random.default_rng(0).normal(size=(50, 3))
    bounds = np.array([1.0, -1.0, 1.0])
    far = [
        ("NaN", points * NAN),
        ("infinite", points * INF),
        ("too far", points + 1e7),
        ("none", points[:0]),
    ]
    wrong_points = [*[case for case in wrong_arrays(points) if case[0] != "unaligned"], *far]
    shape: Arguments = {
        "kind": "cylinder",
        "rotation": np.eye(3),
        "origin": np.zeros(3),
        "bounds": bounds,
    }
    wrong_shape = {
        "kind": [("unknown", "torus"), ("None", None), ("a number", 1)],
        "rotation": [
            *[case for case in wrong_arrays(np.eye(3)) if case[0] != "unaligned"],
            ("NaN", np.full((3, 3), NAN)),
            ("not a rotation", 2 * np.eye(3)),
            ("sheared", np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]])),
        ],
        "origin": [("of two", np.zeros(2)), ("NaN", np.full(3, NAN)), ("far", np.full(3, 1e9))],
        "bounds": [
            ("of a sphere", np.ones(1)),
            ("of a cuboid", np.ones(6)),
            ("NaN", bounds * NAN),
            ("huge", bounds * HUGE),
        ],
    }
    cloud: Arguments = {**shape, "points": points, "normals": points}
    wrong_cloud = {
        **wrong_shape,
        "points": [*wrong_points, ("one less", points[1:])],
        "normals": [*wrong_points[:-1], ("one less", points[1:])],
    }
    yield from variants(
        "shape_distances",
        semmap_native.shape_distances,
        {**shape, "points": points},
        {**{k: iter(v) for k, v in wrong_shape.items()}, "points": wrong_points[:-1]},
    )
    yield from variants(
        "shape_cost",
        semmap_native.shape_cost,
        {**cloud, "tolerance": 0.1},
        {
            **{k: iter(v) for k, v in wrong_cloud.items()},
            "tolerance": wrong_numbers(0.0, -0.1, 1e-200),
        },
    )
    yield from variants(
        "fit_shape",
        semmap_native.fit_shape,
        {**cloud, "whole": points, "spacing": 0.1, "noise": 0.01, "table": None, "turns": 2},
        {
            **{k: iter(v) for k, v in wrong_cloud.items()},
            "whole": wrong_points,
            "spacing": wrong_numbers(-0.1),
            "noise": wrong_numbers(0.0, -0.1, 1e-200),
            "table": [
                ("of four numbers", (0, 0, 1, 0)),
                ("NaN", ((NAN, 0, 1), 0.0)),
                ("far", ((0, 0, 1), HUGE)),
                ("text", "text"),
            ],
            "turns": wrong_counts(0, 17),
        },
    )
    near = np.zeros((4, 5), I8)
    yield from variants(
        "local_planes",
        semmap_native.local_planes,
        {"points": points, "near": near},
        {
            "points": wrong_points,
            "near": [
                *[case for case in wrong_arrays(near) if "column" not in case[0]],
                ("of no columns", near[:, :0]),
                ("below 0", near - 1),
                ("beyond the points", near + 50),
                ("huge", near + 2**62),
            ],
        },
    )
