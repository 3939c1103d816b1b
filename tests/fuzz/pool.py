"""Workers that run cases under limits of time and memory."""

from __future__ import annotations

import base64
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.fuzz.worker import MODULES

SECONDS = 5.0
"""Processor time that a case may take."""

WAITING = 4
"""How much longer it may wait without computing."""

LONGEST = 100
"""How much longer it may take on the clock: others may use the processor."""

MEMORY = 2**30
"""Bytes that a case may take more than the worker had at its start."""

LIVES = 3000
"""Cases after which a worker is replaced, before what caches keep counts as a case's memory."""

SLACK = 6 if MODULES in os.environ else 1
"""How much more of both the sanitizers take."""


@dataclass(frozen=True)
class Result:
    """What came of a case.

    Attributes
    ----------
    outcome : accepted, refused, unexpected, hang, memory or crash
    text : the message, the traceback, or what the worker left behind
    """

    outcome: str
    text: str
    data: bytes
    seconds: float

    @property
    def is_finding(self) -> bool:
        """Whether it is neither accepted nor refused."""
        return self.outcome not in ("accepted", "refused")


class Worker:
    """A process that runs one case at a time, and another process when it dies.

    Parameters
    ----------
    kinds : the module whose `KINDS` it knows
    seconds, memory : the limits of a case
    """

    def __init__(
        self, kinds: str = "tests.fuzz.kinds", seconds: float = SECONDS, memory: int = MEMORY
    ) -> None:
        self._kinds, self._seconds, self._most = kinds, seconds * SLACK, memory * SLACK
        self._process: subprocess.Popen[bytes] | None = None
        self._folder = Path(tempfile.mkdtemp(prefix="semmap-fuzz-"))
        self._current = self._folder / "current"
        self._log = self._folder / "log"
        self._cases = 0
        self._baseline = 0
        self._read = b""  # of its answers

    def close(self) -> None:
        """End the process and remove its files."""
        self._end()
        subprocess.run(["rm", "-rf", str(self._folder)], check=False)

    def run(self, asked: Mapping[str, Any]) -> Result:
        """Run a case: of a kind, by number and seed, or with its data."""
        process = self.ready()
        self._current.unlink(missing_ok=True)
        _of(process.stdin).write(json.dumps(asked).encode() + b"\n")
        _of(process.stdin).flush()
        self._cases += 1
        answer = self._answer(120 * SLACK)  # the input is made
        if answer is None or isinstance(answer, str):
            return self._lost("crash", 0.0)
        start = time.monotonic()
        answer = self._answer(self._seconds)
        seconds = time.monotonic() - start
        if not isinstance(answer, dict):
            return self._lost(answer or "crash", seconds)
        if answer["rss"] > self._baseline + self._most // 2:
            self._end()  # what it keeps would count as the next one's
        return Result(answer["outcome"], answer["text"], self._data(), seconds)

    def _answer(self, seconds: float) -> dict[str, Any] | str | None:
        """The next line of the process; the reason where it gets none, None where it died."""
        process = self._process
        assert process is not None
        start = busy = time.monotonic()
        spent = self._processor_seconds()
        most = spent + seconds
        while True:
            line, newline, rest = self._read.partition(b"\n")
            if newline:
                self._read = rest
                return json.loads(line)
            if select.select([process.stdout], [], [], 0.02)[0]:
                found = os.read(_of(process.stdout).fileno(), 1 << 16)
                if not found:
                    process.wait()
                    return None
                self._read += found
                continue
            if self._memory() > self._baseline + self._most:
                return "memory"
            now, used = time.monotonic(), self._processor_seconds()
            if used > spent:  # it computes, maybe slowly: others do, too
                spent, busy = used, now
            if used > most or now > busy + WAITING * seconds or now > start + LONGEST * seconds:
                return "hang"

    def _memory(self) -> int:
        try:
            pages = Path(f"/proc/{_of(self._process).pid}/statm").read_text().split()[1]
        except (OSError, IndexError):
            return 0
        return int(pages) * os.sysconf("SC_PAGESIZE") if self._baseline else 0

    def _processor_seconds(self) -> float:
        try:
            status = Path(f"/proc/{_of(self._process).pid}/stat").read_text()
        except OSError:
            return 0.0
        user, system = status.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def _lost(self, outcome: str, seconds: float) -> Result:
        """What is known of a case that did not come back."""
        process = _of(self._process)
        if outcome == "hang":
            process.send_signal(signal.SIGUSR1)
            time.sleep(0.5)
        self._end()
        text = f"exit status {process.returncode}\n" if outcome == "crash" else ""
        return Result(
            outcome, text + self._log.read_text(errors="replace")[-6000:], self._data(), seconds
        )

    def _data(self) -> bytes:
        return self._current.read_bytes() if self._current.exists() else b""

    def ready(self) -> subprocess.Popen[bytes]:
        """The process, started where there is none."""
        if self._process is not None and self._cases >= LIVES:
            self._end()
        if self._process is None:
            self._cases = self._baseline = 0
            self._read = b""
            with self._log.open("w") as log:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "tests.fuzz.worker", str(self._current), self._kinds],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    cwd=Path(__file__).parents[2],
                    env=environment(),
                )
            answer = self._answer(120 * SLACK)
            if not isinstance(answer, dict):
                raise RuntimeError(f"the worker does not start:\n{self._log.read_text()[-3000:]}")
            self._baseline = answer["ready"]
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                _of(pipe).close()


def environment() -> dict[str, str]:
    """The variables of a worker; where it tests sanitized modules, also those of the sanitizers."""
    made = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if MODULES in os.environ:
        libraries = [
            subprocess.run(
                ["c++", f"-print-file-name=lib{name}.so"],
                capture_output=True,
                text=True,
                check=True,
            ).stdout.strip()
            for name in ("asan", "ubsan", "stdc++")  # before Python, which is not sanitized
        ]
        # OpenVDB is not sanitized either, and shares containers with what is
        made |= {
            "LD_PRELOAD": ":".join(libraries),
            "ASAN_OPTIONS": "detect_leaks=0:detect_container_overflow=0",
            "UBSAN_OPTIONS": "print_stacktrace=1",
        }
    return made


def _of(value: Any) -> Any:
    assert value is not None
    return value


def encoded(data: bytes) -> str:
    """Bytes as JSON takes them."""
    return base64.b64encode(data).decode()
