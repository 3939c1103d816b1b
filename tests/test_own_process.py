"""Calls in a process of their own, with limits of memory and time."""

from __future__ import annotations

import math
import os
import signal
import time

import pytest

from semmap.ingest.world import WorldError
from semmap.own_process import ProcessEnded, call_apart


def test_the_result_is_that_of_another_process() -> None:
    assert call_apart(math.gcd, 12, 18) == 6
    assert call_apart(os.getpid) != os.getpid()


def test_too_much_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_MAX_READER_BYTES", str(256 * 2**20))
    with pytest.raises(ProcessEnded, match="more than 256 MiB of memory"):
        call_apart(bytes, 2**30)


def test_too_much_time_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_MAX_READER_SECONDS", "0.5")
    with pytest.raises(ProcessEnded, match=r"more than 0\.5 s"):
        call_apart(time.sleep, 60)


def test_a_crash_is_an_error() -> None:
    with pytest.raises(ProcessEnded, match=r"crashes .* \(SIGSEGV\)"):
        call_apart(signal.raise_signal, signal.SIGSEGV)


def _refuse() -> None:
    raise WorldError("kitchen.usd", "file", "is empty", "Export it.")


def test_an_error_of_the_function_is_raised_here() -> None:
    with pytest.raises(WorldError, match=r"kitchen.usd: file: is empty. Export it\.") as caught:
        call_apart(_refuse)
    assert caught.value.problem == "is empty"
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        call_apart(divmod, 1, 0)
