"""`semmap` as a process that is forked from one which has imported it: a user's, but quick.

What a start itself does (imports, entry points) is seen where tests run the installed command.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

context = multiprocessing.get_context("forkserver")
context.set_forkserver_preload(["tests.forked_imports"])

SECONDS = 120.0
"""After which a command counts as stuck."""


def semmap_process(url: str, *words: object) -> subprocess.CompletedProcess[str]:
    """What `semmap WORDS` prints about a database, and how it ends."""
    said = ["semmap", "--db", url, *map(str, words)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = context.Process(
            target=_command, args=(folder, dict(os.environ), Path.cwd(), said), daemon=True
        )
        process.start()
        process.join(SECONDS)
        assert process.exitcode is not None, f"{said} is stuck"
        code = process.exitcode
        process.close()
        out, err = ((folder / stream).read_text() for stream in ("out", "err"))
    return subprocess.CompletedProcess(said, code, out, err)


def _command(folder: Path, environment: Mapping[str, str], at: Path, said: list[str]) -> None:
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(at)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for number, stream in ((1, "out"), (2, "err")):
        os.dup2(os.open(folder / stream, os.O_WRONLY | os.O_CREAT, 0o600), number)
    sys.argv = said
    from semmap.cli import main

    main()
