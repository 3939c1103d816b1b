"""Source that many threads parse at once, which fails in Python before 3.11.5 without a lock."""

from __future__ import annotations

import ast
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from semmap.syntax_tree import parse_expression, parse_module


def test_threads_parse_at_once() -> None:
    source = Path(__file__).read_bytes()
    tree = ast.dump(ast.parse(source))
    with ThreadPoolExecutor(8) as threads:
        assert {*threads.map(ast.dump, threads.map(parse_module, [source] * 200))} == {tree}
        names = [f"a{n} | b{n}" for n in range(200)]
        assert [*map(ast.unparse, threads.map(parse_expression, names))] == names
