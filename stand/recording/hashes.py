"""SHA-256 of what a result was made from."""

import hashlib
from pathlib import Path

_CHUNK = 1 << 20


def sha256_of_text(text: str) -> str:
    """Of a text's UTF-8 bytes."""
    return hashlib.sha256(text.encode()).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Of a file of any size; of a folder (a bag of several files) all of them, by name."""
    digest = hashlib.sha256()
    for part in sorted(path.iterdir()) if path.is_dir() else [path]:
        with part.open("rb") as file:
            while block := file.read(_CHUNK):
                digest.update(block)
    return digest.hexdigest()
