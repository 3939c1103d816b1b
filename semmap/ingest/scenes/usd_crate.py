"""The sections of a USD crate (.usdc), which USD makes room for before it reads them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from semmap.limits import MESH_BYTES

MAGIC = b"PXR-USDC"
HEAD = 24
"""Bytes before the sections: the magic, the version, and where the table of sections is."""

ENTRY = struct.Struct("<16sqq")
"""A row of the table: the name of a section, its first byte, its length."""

ROOM = {b"TOKENS": 24, b"STRINGS": 4, b"FIELDS": 16, b"FIELDSETS": 4, b"PATHS": 16, b"SPECS": 16}
"""Bytes in memory for each item of a section; the section begins with their number."""

SECTIONS = 64
"""Sections of a crate at most; USD writes six."""


def check_crates(path: Path, error: Callable[[str, str], Exception]) -> None:
    """Raise an error for a crate, also in a .usdz, whose sections are beyond its end or too long.

    A file that is not a crate, or is not there, passes.
    """
    try:
        if path.suffix.lower() == ".usdz":
            with ZipFile(path) as packed:
                names = [name for name in packed.namelist() if name.endswith((".usd", ".usdc"))]
                sizes = sum(packed.getinfo(name).file_size for name in names)
                MESH_BYTES.check(sizes, error, "Split it.", "inflates to")
                crates = [packed.read(name) for name in names]
        else:
            with path.open("rb") as file:
                crates = [file.read() if file.read(8) == MAGIC and not file.seek(0) else b""]
    except (OSError, BadZipFile, ValueError, NotImplementedError, RuntimeError):
        return  # USD says why it cannot be read
    for data in crates:
        if data.startswith(MAGIC):
            _check(data, error)


def _check(data: bytes, error: Callable[[str, str], Exception]) -> None:
    damaged = error("is not a stage of USD: its sections end beyond it", "Export it again.")
    try:
        (table,) = struct.unpack_from("<q", data, len(MAGIC) + 8)
        if not HEAD <= table < len(data):
            raise damaged
        (count,) = struct.unpack_from("<Q", data, table)
        if count > SECTIONS:
            raise damaged
        for number in range(count):
            name, start, size = ENTRY.unpack_from(data, table + 8 + number * ENTRY.size)
            if not (start >= HEAD and 0 <= size <= len(data) - start):
                raise damaged
            room = ROOM.get(name.rstrip(b"\0"), 0)
            (items,) = struct.unpack_from("<Q", data, start) if room else (0,)
            MESH_BYTES.check(items * room, error, "Split it.", "takes")
            if name.startswith(b"TOKENS"):
                MESH_BYTES.check(
                    struct.unpack_from("<Q", data, start + 8)[0], error, "Split it.", "inflates to"
                )
    except struct.error:
        raise damaged from None
