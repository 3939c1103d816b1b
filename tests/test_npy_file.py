"""NumPy files that are read, and those that are refused before their values are."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from semmap.npy_file import read_npy


@pytest.mark.parametrize("kind", ["?", "u1", ">i4", "f4", "f8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_real_numbers_are_read_as_numpy_reads_them(kind: str, order: str, tmp_path: Path) -> None:
    given = np.asarray(np.arange(12).reshape(3, 4) % 7, dtype=kind, order=order)
    np.save(tmp_path / "a.npy", given)
    found = read_npy(tmp_path / "a.npy")
    assert (found.dtype, found.tolist()) == (given.dtype, given.tolist())
    stream = io.BytesIO(b"before" + (tmp_path / "a.npy").read_bytes())
    stream.seek(6)
    assert read_npy(stream).tolist() == given.tolist()


def test_others_are_refused_by_their_header(tmp_path: Path) -> None:
    file = tmp_path / "a.npy"
    for array, message in (
        (np.ones(3, complex), "complex128: give real numbers"),
        (np.array(["a"]), "give real numbers"),
        (np.zeros(2, [("x", "f8")]), "give real numbers"),
    ):
        np.save(file, array)
        with pytest.raises(ValueError, match=message):
            read_npy(file)
    for content in (b"", b"PK", b"\x93NUMPY\x09\x09"):
        file.write_bytes(content)
        with pytest.raises(ValueError, match=r"magic|version"):
            read_npy(file)


def test_a_sparse_file_is_refused_before_its_zeros_are_read(tmp_path: Path) -> None:
    file = tmp_path / "sparse.npy"
    with file.open("wb") as stream:
        header = {"descr": "<f4", "fortran_order": False, "shape": (100_000_000,)}
        npy.write_array_header_1_0(stream, header)
        os.truncate(stream.fileno(), stream.tell() + 400_000_000)
    with pytest.raises(ValueError, match=r"100,000,000 values.*SEMMAP_MAX_ARRAY_VALUES"):
        read_npy(file)
