"""A program that works beside the moves: its memory and its open files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
COMMAND = ("-c", "from semmap.cli import main; main()")


class Program(subprocess.Popen[str]):
    """A Python process whose standard input and output are ours; it ends with its context."""

    def __init__(self, *arguments: str, **options: Any) -> None:
        command = [sys.executable, *arguments]
        pipe = subprocess.PIPE
        super().__init__(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT, **options)

    def __exit__(self, *error: Any) -> None:
        self.kill()
        super().__exit__(*error)

    def line(self) -> str:
        """The next line that it prints."""
        assert self.stdout is not None
        return self.stdout.readline()

    def ask(self) -> str:
        """Its answer to an empty line."""
        assert self.stdin is not None
        self.stdin.write("\n")
        self.stdin.flush()
        return self.line().strip()

    @property
    def memory(self) -> int:
        """Bytes that are resident."""
        pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGESIZE")

    @property
    def files(self) -> int:
        """The number of open files, sockets included."""
        return sum(1 for _ in Path(f"/proc/{self.pid}/fd").iterdir())
