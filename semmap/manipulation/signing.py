"""The key with which a user signs bundles of knowledge: Ed25519, in a file of the data folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from semmap.data_folder import default_home
from semmap.manipulation.error import ManipulationError


def key_file() -> Path:
    """Return the file of the private key; only its owner reads it."""
    return default_home() / "manipulation.key"


def own_key(path: Path | None = None) -> Any:
    """The signing key, which is made where there is none.

    ManipulationError where the file is not a key, or PyNaCl is not installed.
    """
    signing = _library()
    path = key_file() if path is None else path
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


def public_key(key: Any) -> bytes:
    """Return the public half of a signing key, 32 bytes."""
    return bytes(key.verify_key)


def sign(key: Any, content: bytes) -> bytes:
    """Return the signature of a content, 64 bytes."""
    return bytes(key.sign(content).signature)


def is_signed(content: bytes, signature: bytes, key: bytes) -> bool:
    """Return whether a signature of a content is by the owner of a public key."""
    signing = _library()
    from nacl.exceptions import BadSignatureError

    try:
        signing.VerifyKey(key).verify(content, signature)
    except (BadSignatureError, ValueError, TypeError):
        return False
    return True


def _library() -> Any:
    try:
        from nacl import signing
    except ImportError as error:
        raise ManipulationError(
            "bundles need PyNaCl, which is not installed: pip install 'semmap[manipulation]'"
        ) from error
    return signing
