"""What the source of the face says of a method: its arguments, its result and its help.

Nothing is imported for it, so that the command line starts quickly.
"""

from __future__ import annotations

import ast
import re
import textwrap
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from semmap.syntax_tree import parse_module

REQUIRED = object()
"""The default of an argument that must be given."""

_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
_AS_FOR = re.compile(r"as for `(?:(\w+)\.)?(\w+)`(?:; )?(.*)")


class Argument(NamedTuple):
    """One argument of a method, as the source has it; `help` is its line in the docstring."""

    name: str
    annotation: str
    default: Any
    help: str


class Signature(NamedTuple):
    """What a method takes and returns; `help` is the first line of its docstring."""

    arguments: tuple[Argument, ...]
    result: str
    help: str


@cache
def read_signature(method: str) -> Signature:
    """Return the signature of a method of the face, such as ``Map.route``.

    An argument that is described "as for" another method has the words of that method. LookupError
    if no class of the face has the method.
    """
    owner, _, name = method.partition(".")
    function = _function(owner, name)
    doc = ast.get_docstring(function) or ""
    prose, said = sections(doc)[""], described(sections(doc).get("Parameters", ""))
    given = function.args
    named = [*given.posonlyargs, *given.args]
    absent = [None] * (len(named) - len(given.defaults))
    pairs = [*zip(named, [*absent, *given.defaults], strict=True)]
    pairs += zip(given.kwonlyargs, given.kw_defaults, strict=True)
    arguments = [
        Argument(
            one.arg, _text(one.annotation), _value(default), _help(owner, one.arg, said, prose)
        )
        for one, default in pairs
        if one.arg != "self"
    ]
    return Signature(tuple(arguments), _text(function.returns), doc.partition("\n")[0])


@cache
def sections(doc: str) -> dict[str, str]:
    """The sections of a docstring by their titles; the text before them has none."""
    parts = _SECTION.split(doc)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def described(section: str) -> dict[str, str]:
    """What a section of a docstring says of each name: ``name, other : text``."""
    found: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", section):
        head, _, body = entry.strip().partition("\n")
        names, _, first = head.partition(" :")
        body = " ".join(body.split())
        if body[:1].isupper() and not first.endswith((".", ",", ";", ":")):  # first is a type
            first = f"{first}." if first.startswith(" (") else ""
        for name in names.split(", "):
            found.setdefault(name.strip(), f"{first.strip()} {body}".strip())
    return found


def _mentioned(name: str, prose: str) -> str:
    """What a sentence of a docstring says of an argument that it begins with: ```name`: text.``"""
    found = re.search(rf"(?<![^.]\s)`{name}`:? (.*?)\.(?=\s|$)", " ".join(prose.split()))
    return found[1] if found else ""


def _help(owner: str, name: str, said: dict[str, str], prose: str) -> str:
    text = said.get(name) or _mentioned(name, prose)
    reference = _AS_FOR.match(text)
    if reference is None:
        return text
    home, method, more = reference.groups()
    there = read_signature(f"{home or owner}.{method}").arguments
    words = (one.help for one in there if one.name == name)
    return "; ".join(filter(None, [next(words, ""), more]))


def _function(owner: str, name: str) -> ast.FunctionDef:
    """The definition of a method, in the class or in one of its bases."""
    todo = [owner]
    while todo:
        bases, source = _classes().get(todo.pop(0), ((), ""))
        begin = rf"^    def {name}\(.*?(?=^ {{0,4}}[^\s)]|\Z)"
        if found := re.search(begin, source, re.MULTILINE | re.DOTALL):
            node = parse_module(textwrap.dedent(found[0])).body[0]
            assert isinstance(node, ast.FunctionDef)
            return node
        todo += bases
    raise LookupError(f"{owner} has no method {name}")


@cache
def _classes() -> dict[str, tuple[tuple[str, ...], str]]:
    """The names of the bases, and the source, of each class of the face."""
    found = {}
    for file in Path(__file__).parent.glob("*.py"):
        for part in re.split(r"^(?=class )", file.read_text("utf-8"), flags=re.MULTILINE)[1:]:
            name, _, bases = part[len("class ") : part.index(":\n")].partition("(")
            found[name] = (tuple(re.findall(r"\w+", bases)), part)
    return found


def _text(annotation: ast.expr | None) -> str:
    return "" if annotation is None else ast.unparse(annotation)


def _value(default: ast.expr | None) -> Any:
    """The value of a default; None of one that is no literal, such as a function."""
    if default is None:
        return REQUIRED
    try:
        return ast.literal_eval(default)
    except ValueError:
        return None
