"""Files that are there whole or not at all, also after a power cut."""

import contextlib
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import yaml

from apf.errors import InputError

SAFE_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The one in C, where PyYAML has it, takes a tenth of the time."""


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Where to write what then takes the place of `path`, in one step and on the disk; or, on an error, does not."""
    half = path.with_name(path.name + ".part")
    try:
        yield half
        sync(half)
        half.replace(path)
        sync(path.parent)
    finally:
        with contextlib.suppress(OSError):
            half.unlink()


def sync(path: Path) -> None:
    """Wait until a file, or the list of a folder's files, is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def checksum(path: Path) -> str | None:
    """Eight hexadecimal digits of a file's bytes, or None if it cannot be read."""
    try:
        return f"{zlib.crc32(path.read_bytes()):08x}"
    except OSError:
        return None


def write_yaml(path: Path, content: dict) -> None:
    """Write a YAML file, replacing it in one step."""
    with replacing(path) as half:
        half.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))


def read_yaml(path: Path) -> dict:
    """Raises InputError if there is no such file, or it is no YAML mapping."""
    try:
        content = yaml.load(path.read_text(), SAFE_LOADER)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a YAML file: {str(error).splitlines()[0]}") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a YAML mapping")
    return content
