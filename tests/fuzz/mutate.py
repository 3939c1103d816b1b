"""Mutations of bytes, of words and of trees, all of them made by one random generator."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from copy import deepcopy
from random import Random
from typing import Any
from xml.etree import ElementTree

import yaml

MOST_BYTES = 200_000
"""Of a case: what takes gigabytes or minutes must not need a large file."""

NUMBERS = (
    "0",
    "-0",
    "-1",
    "1",
    "2",
    "0.5",
    "1e-310",
    "1e-9",
    "1e9",
    "1e15",
    "1e308",
    "-1e308",
    "1e400",
    "nan",
    ".nan",
    "NaN",
    "inf",
    "-inf",
    ".inf",
    "Infinity",
    "127",
    "128",
    "255",
    "256",
    "32768",
    "65535",
    "65536",
    "2147483647",
    "2147483648",
    "-2147483649",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "0x10",
    "0b1",
    "1_000",
    "1,5",
    "1:30",
    "0777",
    "3.141592653589793",
    "99999",
    "9" * 400,
)
WORDS = (
    "",
    " ",
    "\0",
    "\n",
    "\t",
    "\u202e",
    "\ud7ff",
    "é",
    "日本",
    "a" * 600,
    "../../etc/passwd",
    "/dev/zero",
    "http://localhost/x",
    "file://",
    "%s%n",
    "${x}",
    "'",
    '"',
    "]]>",
    "<!--",
    "&lt;",
    "&x;",
    "null",
    "~",
    "true",
    "None",
    "*",
    "**",
    "[",
    "]",
    "{",
    "}",
    "(",
    ")",
    "<",
    ">",
    ":",
    ";",
    ",",
    "#",
    "//",
    "\\",
    "@",
    "name",
    "outside",
    "world",
    "map",
    "robot",
    "model",
    "base_link",
    "room",
    "self",
)
ODD: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    2**31,
    -(2**63),
    10**30,
    0.5,
    1e308,
    -1e308,
    1e-310,
    float("nan"),
    float("inf"),
    float("-inf"),
    "",
    "\0",
    "x" * 600,
    [],
    {},
    [[]],
    [None],
    {"a": 1},
    {"": None},
    [[[[[[[[[[]]]]]]]]]],
    [0, 0],
    [1e308, 1e308],
    ["a"],
    "outside",
    "nan",
    "1e400",
)

_WORD = re.compile(r"[-+]?\d[\w.+-]*|\w+|\s+|.", re.DOTALL)


def bytes_of(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """Bits flipped, ranges cut, repeated, overwritten, or taken from another seed."""
    data = bytearray(seed)
    for _ in range(_few(random)):
        size = len(data)
        at, length = random.randrange(size + 1), min(_few(random) ** 2, size)
        match random.randrange(9):
            case 0 if size:
                data[at % size] ^= 1 << random.randrange(8)
            case 1:
                data[at:at] = random.randbytes(length)
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length] * random.choice((1, 2, 10, 1000))
            case 4:
                data[at : at + 4] = random.choice(_INTEGERS).to_bytes(4, "little")
            case 5:
                data[at : at + 8] = random.choice(_INTEGERS).to_bytes(8, "big")
            case 6:
                data[at : at + length] = bytes([random.choice((0, 255, 32, 127))]) * length
            case 7:
                del data[at:]
            case _:
                other = random.choice(others)
                start = random.randrange(len(other) + 1)
                data[at:at] = other[start : start + 10 * length]
        del data[MOST_BYTES:]
    return bytes(data)


_INTEGERS = (0, 1, 2, 255, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 10**6, 10**9)


def words_of(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """Numbers and words replaced, repeated, swapped, left out, or taken from another seed."""
    words = _split(seed)
    pool = _split(random.choice(others)) or [" "]
    for _ in range(_few(random)):
        if not words:
            words = list(pool)
        at = random.randrange(len(words))
        match random.randrange(8):
            case 0 | 1:
                kind = str.isalpha if words[at][:1].isalpha() else str.isdigit
                same = [i for i, word in enumerate(words) if kind(word[:1])] or [at]
                at = random.choice(same)
                words[at] = random.choice(NUMBERS if kind is str.isdigit else WORDS)
            case 2:
                words[at] = random.choice(pool)
            case 3:
                del words[at : at + _few(random)]
            case 4:
                end = at + _few(random)
                words[at:at] = words[at:end] * random.choice((1, 2, 30, 3000))
            case 5:
                other = random.randrange(len(words))
                words[at], words[other] = words[other], words[at]
            case 6:
                start = random.randrange(len(pool))
                words[at:at] = pool[start : start + 3 * _few(random)]
            case _:
                words.insert(at, random.choice(random.choice((NUMBERS, WORDS))))
    return "".join(words).encode("utf-8", "surrogatepass")[:MOST_BYTES]


def lines_of(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """Lines repeated, swapped, left out, or taken from another seed."""
    lines = seed.splitlines(keepends=True)
    for _ in range(_few(random)):
        if not lines:
            break
        at, other = random.randrange(len(lines)), random.randrange(len(lines))
        match random.randrange(4):
            case 0:
                lines[at:at] = lines[at : at + _few(random)] * random.choice((1, 2, 50))
            case 1:
                lines[at], lines[other] = lines[other], lines[at]
            case 2:
                del lines[at : at + _few(random)]
            case _:
                lines.insert(at, random.choice(random.choice(others).splitlines(True) or [b"\n"]))
    return b"".join(lines)[:MOST_BYTES]


def json_tree(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """A JSON document with changed values."""
    tree = _tree(random, json.loads(seed), [json.loads(other) for other in others[:3]])
    return json.dumps(tree).encode("utf-8", "surrogatepass")[:MOST_BYTES]


def yaml_tree(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """A YAML document with changed values."""
    loaded = [yaml.load(other, yaml.CSafeLoader) for other in others[:3]]
    tree = _tree(random, yaml.load(seed, yaml.CSafeLoader), loaded)
    text = yaml.dump(tree, Dumper=yaml.CSafeDumper, allow_unicode=True)
    return text.encode("utf-8", "replace")[:MOST_BYTES]


def xml_tree(random: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """An XML document with elements moved, repeated and nested, and changed texts."""
    root = ElementTree.fromstring(seed)
    for _ in range(_few(random)):
        elements = list(root.iter())
        element = random.choice(elements)
        parent = random.choice(elements)
        match random.randrange(7):
            case 0:
                element.text = random.choice(random.choice((NUMBERS, _PRINTABLE)))
            case 1 if element.text:
                element.text = _numbers(random, element.text)
            case 2 if element.attrib:
                key = random.choice(list(element.attrib))
                element.set(key, _numbers(random, element.get(key, "")))
            case 3:
                parent.extend(deepcopy([element]) * random.choice((1, 1, 2, 40)))
            case 4 if len(parent):
                parent.remove(random.choice(list(parent)))
            case 5:
                inner = element
                for _ in range(random.choice((1, 5, 100, 2000))):
                    made = ElementTree.SubElement(inner, random.choice(elements).tag)
                    inner = made
            case _:
                element.tag = random.choice(elements).tag
        if sum(1 for _ in root.iter()) > 5000:
            break
    return ElementTree.tostring(root)[:MOST_BYTES]


_PRINTABLE = tuple(word for word in WORDS if word.isprintable())


def _numbers(random: Random, text: str) -> str:
    """A text with one of its words replaced."""
    words = text.split(" ")
    words[random.randrange(len(words))] = random.choice(random.choice((NUMBERS, _PRINTABLE)))
    return " ".join(words)


def _tree(random: Random, tree: Any, others: Sequence[Any]) -> Any:
    """A document of mappings and lists with changed values."""
    for _ in range(_few(random)):
        places = list(_places(tree))
        if not places:
            return random.choice(ODD)
        holder, key = random.choice(places)
        match random.randrange(8):
            case 0 | 1:
                holder[key] = deepcopy(random.choice(ODD))
            case 2:
                other, at = random.choice(places)
                holder[key] = deepcopy(other[at])
            case 3 if isinstance(holder, list):
                holder[key:key] = deepcopy(holder[key : key + 2]) * random.choice((1, 2, 50))
            case 4:
                del holder[key]
            case 5:
                inner = holder[key]
                for _ in range(random.choice((1, 5, 70, 300))):
                    inner = random.choice(([inner], {"a": inner}))
                holder[key] = inner
            case 6:
                found = list(_places(random.choice(others)))
                if found:
                    other, at = random.choice(found)
                    holder[key] = deepcopy(other[at])
            case _ if isinstance(holder, dict):
                holder[random.choice([*map(str, holder), *WORDS[:20]])] = holder[key]
    return tree


def _places(tree: Any, depth: int = 0) -> list[tuple[Any, Any]]:
    """Each holder and key in a document."""
    if depth > 40 or not isinstance(tree, list | dict):
        return []
    keys = list(tree) if isinstance(tree, dict) else range(min(len(tree), 200))
    found = [(tree, key) for key in keys]
    for key in keys:
        found += _places(tree[key], depth + 1)
    return found[:3000]


def _split(seed: bytes) -> list[str]:
    return _WORD.findall(seed.decode("utf-8", "replace"))


def _few(random: Random) -> int:
    """Mostly 1, seldom more."""
    return min(int(random.paretovariate(1.2)), 40)


Mutation = Callable[[Random, bytes, Sequence[bytes]], bytes]
