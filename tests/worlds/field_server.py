"""`semmap fields serve` as a process, and questions to it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any

from tests.command_line import semmap

MAIN = "from semmap.cli import main; main()"


class Server:
    """`semmap fields serve` as a process."""

    def __init__(self, url: str, *options: str, env: Mapping[str, str] | None = None) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", MAIN, "--db", url, "fields", "serve", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"SEMMAP_DB": ""} | dict(env or {}),
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line.startswith("serving house on"), line + self.process.stdout.read()

    def stop(self) -> str:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.communicate(timeout=30)[0]


def fields(url: str, *words: object) -> Any:
    done = semmap(url, "fields", *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def eventually(ask: Any, wanted: Any, seconds: float = 10) -> None:
    end = time.monotonic() + seconds
    while ask() != wanted:
        assert time.monotonic() < end, (ask(), wanted)
        time.sleep(0.05)
