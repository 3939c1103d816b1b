"""The key with which a user signs bundles of knowledge: Ed25519, in a file of the data folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from semmap.data_folder import default_home
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.extra import library


def own_key(path: Path | None = None) -> Any:
    """The signing key, made where there is none, in a file that only its owner reads."""
    signing = library("nacl.signing")
    path = default_home() / "manipulation.key" if path is None else path
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(bytes(signing.SigningKey.generate()).hex() + "\n")
    try:
        return signing.SigningKey(bytes.fromhex(path.read_text().strip()))
    except (ValueError, UnicodeDecodeError, TypeError) as error:
        raise ManipulationError(
            f"{path}: is not a signing key: restore it, or remove it to get a new one"
        ) from error


def is_signed(content: bytes, signature: bytes, key: bytes) -> bool:
    """Return whether a signature of a content is by the owner of a public key."""
    signing, refused = library("nacl.signing"), library("nacl.exceptions").BadSignatureError
    try:
        signing.VerifyKey(key).verify(content, signature)
    except (refused, ValueError, TypeError):
        return False
    return True
