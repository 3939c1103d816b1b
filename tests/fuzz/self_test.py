"""A kind of input that misbehaves as it is told to, for the tests of the workers."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from random import Random

import numpy as np

from tests.fuzz.kind import Kind


def _same(_: Random, seed: bytes, __: Sequence[bytes]) -> bytes:
    return seed


def _misbehave(data: bytes, folder: Path) -> None:
    match data.decode():
        case "accept":
            (folder / "written").write_bytes(data)
        case "refuse":
            raise ValueError("this input is refused")
        case "refuse silently":
            raise ValueError
        case "fail":
            raise KeyError("missing")
        case "sleep":
            time.sleep(60)
        case "compute":
            while True:
                pass
        case "allocate":
            taken = np.ones(50_000_000)  # 400 MB
            time.sleep(1)
            del taken
        case "allocate too much":
            np.ones(10**12)
        case "abort":
            os.abort()


SELF_TEST = Kind("self test", lambda: [b"accept"], [_same], _misbehave, (ValueError,), False)
KINDS = {SELF_TEST.name: SELF_TEST}
