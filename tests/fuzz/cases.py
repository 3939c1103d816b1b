"""Findings kept as files: inputs that once ended in something else than an answer or a refusal."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent / "cases"


@dataclass(frozen=True)
class Case:
    """An input of a kind and what is to come of it: accepted or refused, None for either."""

    name: str
    kind: str
    expected: str | None
    data: bytes


def kept() -> Iterator[Case]:
    """All that are kept."""
    for path in sorted(FOLDER.glob("*.json")):
        said = json.loads(path.read_text("utf-8"))
        data = said["text"].encode() if "text" in said else base64.b64decode(said["base64"])
        yield Case(path.stem, said["kind"], said.get("expected"), data)


def keep(kind: str, data: bytes, found: str, folder: Path = FOLDER) -> Path:
    """Keep an input with what came of it."""
    try:
        content = {"text": data.decode()}
    except UnicodeDecodeError:
        content = {"base64": base64.b64encode(data).decode()}
    name = f"{kind.replace(' ', '_')}-{hashlib.sha256(data).hexdigest()[:10]}.json"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    said = {"kind": kind, "expected": None, "found": found.splitlines()[-1:], **content}
    path.write_text(json.dumps(said, indent=1, ensure_ascii=False) + "\n", "utf-8")
    return path
