"""Calls of libraries that a damaged file can crash or exhaust, each in a process of its own."""

from __future__ import annotations

import os
import pickle
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from semmap.error import Error
from semmap.limits import READER_BYTES, READER_SECONDS

P = ParamSpec("P")
T = TypeVar("T")

MEMORY_ERRORS = (b"MemoryError", b"std::bad_alloc", b"Cannot allocate memory")


class ProcessEnded(ValueError):
    """The process ended at a limit or by a crash; the message says which."""


def call_apart(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function of a module in a new process with limits of memory and time.

    Raises
    ------
    ProcessEnded
        The process reached a limit or crashed.
    Error
        The one that the function raised.
    RuntimeError
        The function raised another one; the message is its traceback.
    """
    command = [sys.executable, "-P", "-m", __name__]
    given = pickle.dumps((function, args, kwargs))
    try:
        done = subprocess.run(
            command, input=given, capture_output=True, check=False, timeout=READER_SECONDS.value
        )
    except subprocess.TimeoutExpired:
        raised = f"{READER_SECONDS.variable} raises the limit"
        problem = f"takes more than {READER_SECONDS.text(READER_SECONDS.value)} ({raised})"
        raise ProcessEnded(problem) from None
    if done.returncode and any(each in done.stderr for each in MEMORY_ERRORS):
        raised = f"{READER_BYTES.variable} raises the limit"
        most = READER_BYTES.text(READER_BYTES.value)
        raise ProcessEnded(f"takes more than {most} of memory ({raised})")
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        raise ProcessEnded(f"crashes the library that reads it ({name})")
    if done.returncode:
        raise RuntimeError(done.stderr.decode(errors="replace").strip())
    result, error = pickle.loads(done.stdout)
    if error is not None:
        raise error
    made: T = result
    return made


def _answer() -> None:
    """Read a call from standard input, and write its result or its error to standard output."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a library may print
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    most = int(READER_BYTES.value)
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    function, args, kwargs = pickle.load(sys.stdin.buffer)
    try:
        answer: tuple[object, Error | None] = function(*args, **kwargs), None
    except Error as error:
        answer = None, error
    pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
    answers.close()


if __name__ == "__main__":
    _answer()
