"""SPARQL in shapes with a limit of time: nothing stops rdflib but the end of its process."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rdflib

from semmap.ingest.world import WorldError
from semmap.limits import QUERY_SECONDS
from semmap.own_process import ProcessEnded, call_apart

Check = Callable[..., rdflib.Graph]


def checked_apart(check: Check, seconds: float, path: Path, *args: Any) -> rdflib.Graph:
    """Return the report of a check in a new process; WorldError names the shape that is slow."""
    try:
        return call_apart(_timed, check, seconds, path, *args)
    except ProcessEnded as error:
        raise WorldError(path, "sh:sparql", str(error), "Make it more selective.") from error


class _TooLong(BaseException):
    """The time is over; no handler of errors in rdflib catches it."""


def _timed(check: Check, seconds: float, path: Path, *args: Any) -> rdflib.Graph:
    from pyshacl.shape import Shape  # not when the time is over, maybe in the middle of its import

    def stop(_: int, frame: Any) -> None:
        raise _TooLong(_shape_in(frame, Shape))

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return check(*args)
    except _TooLong as error:
        problem = f"its SPARQL was stopped after {seconds:.3g} s"
        fix = f"Make it more selective, or raise {QUERY_SECONDS.variable}."
        raise WorldError(path, f"shape {error}", problem, fix) from error
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _shape_in(frame: Any, kind: type[Any]) -> str:
    """Return the IRI of the shape that pySHACL checks in a frame of the stack, or of one above."""
    while frame is not None:
        shape = frame.f_locals.get("self")
        if isinstance(shape, kind) and isinstance(shape.node, rdflib.URIRef):
            return str(shape.node)
        frame = frame.f_back
    return "without an IRI"
