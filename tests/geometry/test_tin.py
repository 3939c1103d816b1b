"""TINs against PostGIS, which reads what is written and writes what is read."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from sqlalchemy import Engine, text

from semmap.geometry.tin import decode_patch, encode_chunks, to_mesh

some_triangles = arrays.arrays(
    np.float64,
    st.tuples(st.integers(0, 40), st.just(3), st.just(3)),
    elements=st.floats(-1e6, 1e6),
)


def in_any_order(triangles: np.ndarray) -> list[bytes]:  # type: ignore[type-arg]
    return sorted(t.tobytes() for t in triangles)


def decode(patches: Iterable[bytes]) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate([np.empty((0, 3, 3)), *map(decode_patch, patches)])


@settings(max_examples=50)
@given(some_triangles, st.integers(1, 17))
def test_what_is_written_is_read(triangles: np.ndarray, size: int) -> None:  # type: ignore[type-arg]
    kept = decode(encode_chunks(triangles, size, keep_order=True))
    np.testing.assert_array_equal(kept, triangles)
    ordered = decode(encode_chunks(triangles, size))
    assert in_any_order(ordered) == in_any_order(triangles)


def test_postgis_reads_and_writes_the_same(engine: Engine) -> None:
    triangles = np.random.default_rng(1).uniform(-9, 9, (5, 3, 3))
    (patch,) = encode_chunks(triangles)
    with engine.connect() as connection:
        count, kind, z, back = connection.execute(
            text(
                "SELECT ST_NumGeometries(g), GeometryType(g), ST_Z(ST_PointN("
                "ST_ExteriorRing(ST_GeometryN(g, 2)), 3)), ST_AsEWKB(g) "
                "FROM (SELECT CAST(CAST(:patch AS bytea) AS geometry) AS g) s"
            ),
            {"patch": patch},
        ).one()
    assert (count, kind) == (5, "TIN")
    assert z == triangles[1, 2, 2]
    np.testing.assert_array_equal(decode_patch(bytes(back)), triangles)


def test_patches_are_compact() -> None:
    random = np.random.default_rng(2)
    centres = random.uniform(0, 100, (4096, 1, 3))
    triangles = centres + random.uniform(-0.1, 0.1, (4096, 3, 3))
    extents = [
        np.ptp(decode_patch(p).reshape(-1, 3), axis=0).prod() for p in encode_chunks(triangles, 256)
    ]
    assert sum(extents) < 0.5 * len(extents) * 100**3


@pytest.mark.parametrize("damage", [b"", b"\x00" * 9, b"\x01\x10\x00\x00\x80\x05\x00\x00\x00"])
def test_other_bytes_are_refused(damage: bytes) -> None:
    with pytest.raises(ValueError, match=r"TIN|buffer"):
        decode_patch(damage)


def test_a_mesh_shares_its_corners() -> None:
    triangles = np.array(
        [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]], float
    )
    mesh = to_mesh(triangles)
    assert len(mesh.vertices) == 4
    np.testing.assert_array_equal(mesh.triangles, triangles)
