"""Programs run by ProbLog."""

from __future__ import annotations

import re
import sys
import warnings

_LIMIT = sys.getrecursionlimit()
with warnings.catch_warnings():
    for old in (DeprecationWarning, SyntaxWarning):  # its copy of pyparsing, its docstrings
        warnings.simplefilter("ignore", old)
    from problog import get_evaluatable
    from problog.program import PrologString
sys.setrecursionlimit(_LIMIT)  # ProbLog raises it for the whole process


def places_by_problog(program: str) -> dict[tuple[str, str], float]:
    """P(object at place) by names, of a program that queries is_in(object, place)."""
    answers = get_evaluatable().create_from(PrologString(program)).evaluate()
    return {
        (_name(str(term.args[0])), _name(str(term.args[1]))): float(p)
        for term, p in answers.items()
    }


def _name(atom: str) -> str:
    """The text of an atom, which ProbLog keeps as it was written."""
    if not atom.startswith("'"):
        return atom
    return re.sub(r"\\(.)", lambda m: "\n" if m[1] == "n" else m[1], atom[1:-1])
