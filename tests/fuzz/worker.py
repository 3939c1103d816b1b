"""A process that runs cases, one a line, and is killed when one takes too long or too much.

It reads JSON from standard input and writes the outcome of each case to standard output. The input
of the case that runs is in the file `current`, for when it does not come back.
"""

from __future__ import annotations

import base64
import faulthandler
import importlib
import importlib.util
import json
import logging
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import Any

from tests.fuzz.kind import SERVER

MODULES = "SEMMAP_FUZZ_MODULES"
"""Environment variable with a folder of native modules to test in place of those installed."""

SPARE = 2**32
"""Bytes of address space that a worker may take beyond those at its start; the kernel enforces it.

It is more than a case may use: what earlier cases freed is not all given back."""


def load_modules() -> None:
    """The native modules of the folder that `MODULES` names."""
    folder = os.environ.get(MODULES)
    for name in ("semmap_native", "semmap_vdb") if folder else ():
        (path,) = Path(str(folder)).glob(f"{name}.*.so")
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)


def memory(field: str) -> int:
    """Bytes of a field of this process's status, such as VmRSS."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.split(f"{field}:")[1].split()[0])


def outcome_of(kind: Any, data: bytes, folder: Path) -> dict[str, str]:
    """Whether an input was accepted, refused, or what else came of it."""
    try:
        kind.run(data, folder)
    except MemoryError:
        return {"outcome": "memory", "text": traceback.format_exc(limit=-6)}
    except kind.refused as error:
        if not str(error).strip():
            return {"outcome": "unexpected", "text": f"{type(error).__name__} without a text"}
        return {"outcome": "refused", "text": f"{type(error).__name__}: {error}"[:300]}
    except BaseException:
        return {"outcome": "unexpected", "text": traceback.format_exc(limit=-6)}
    return {"outcome": "accepted", "text": ""}


def main() -> None:
    """Answer until standard input ends."""
    current = Path(sys.argv[1])
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print is no answer
    faulthandler.enable()
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    warnings.simplefilter("ignore")
    logging.disable()
    load_modules()
    kinds = importlib.import_module(sys.argv[2]).KINDS

    for kind in kinds.values():
        if kind.server and SERVER not in os.environ:
            continue
        assert kind.seeds
        outcome_of(kind, kind.seeds[0], Path(tempfile.mkdtemp(dir=current.parent)))
    if MODULES not in os.environ:
        most = memory("VmData") + SPARE
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    print(json.dumps({"ready": memory("VmRSS")}), file=answers)
    for line in sys.stdin:
        asked = json.loads(line)
        kind = kinds[asked["kind"]]
        if "data" in asked:
            data = base64.b64decode(asked["data"])
        else:
            data = kind.case(asked["number"], asked["seed"])
        current.write_bytes(data)
        folder = Path(tempfile.mkdtemp(dir=current.parent))
        print(json.dumps({"started": True}), file=answers)
        found = outcome_of(kind, data, folder)
        shutil.rmtree(folder, ignore_errors=True)
        print(json.dumps(found | {"rss": memory("VmRSS")}), file=answers)


if __name__ == "__main__":
    main()
