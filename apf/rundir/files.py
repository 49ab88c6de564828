"""Files that are there whole or not at all, also after a power cut, and that take the place of nothing else."""

import contextlib
import os
import re
import secrets
import zlib
from collections.abc import Iterator
from pathlib import Path

import yaml

from apf.errors import InputError

HALF = re.compile(r"\..+\.[0-9a-f]{8}\.apf-part")
"""Names of files that `replacing` has not finished."""
SAFE_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""PyYAML's loader. The one in C, where PyYAML has it, takes a tenth of the time."""


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Context: gives the path of a temporary file, which then replaces `path` in one step, synced to the disk.

    On an error `path` stays as before. The file gets the mode of any new file, even if a library sets another mode.
    """
    half = path.with_name(f".{path.name}.{secrets.token_hex(4)}.apf-part")
    try:
        half.touch(exist_ok=False)
        mode = half.stat().st_mode & 0o777
        yield half
        if half.stat().st_mode & 0o777 != mode:
            half.chmod(mode)
        sync(half)
        half.replace(path)
        sync(path.parent)
    finally:
        with contextlib.suppress(OSError):
            half.unlink()


def remove_unfinished(folder: Path) -> None:
    """Remove the temporary files that a killed process left in the folder."""
    for path in folder.glob(".*.apf-part"):
        if HALF.fullmatch(path.name):
            path.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Wait until a file, or the list of a folder's files, is on the disk."""
    if os.name == "nt" and path.is_dir():
        return  # Windows opens no folders, and keeps their lists itself
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, if they are missing; all of them are on the disk then."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        sync(path.parent)


def sync_path_to(folder: Path) -> None:
    """Wait until a folder that somebody else made is on the disk, and those above it: as far as they can be read."""
    for path in (folder.absolute(), *folder.absolute().parents):
        with contextlib.suppress(OSError):
            sync(path)


def checksum(path: Path) -> str | None:
    """Eight hexadecimal digits of a file's bytes, or None if there is no such file.

    Raises InputError if there is one that cannot be read.
    """
    try:
        return f"{zlib.crc32(path.read_bytes()):08x}"
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def write_yaml(path: Path, content: dict) -> None:
    """Write a YAML file, replacing it in one step."""
    with replacing(path) as half:
        half.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))


def read_yaml(path: Path) -> dict:
    """Raises InputError if there is no such file, or it is no YAML mapping."""
    try:
        text = path.read_text()
        if "*" in text and any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, SAFE_LOADER)):
            raise InputError(
                f"{path}: an alias (*): by aliases a small file can fill the memory; write the value itself"
            )
        content = yaml.load(text, SAFE_LOADER)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: no text, or a date that there is not
        raise InputError(f"{path}: not a YAML file: {str(error).splitlines()[0]}") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a YAML mapping")
    return content
