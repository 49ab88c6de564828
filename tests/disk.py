"""A disk that keeps only what was synced, for tests of what a power cut leaves."""

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest


class Disk:
    """Notes, at each `os.fsync`, what is then on the disk: the bytes of a file, or the names in a folder.

    Nothing else ever gets there: it is the slowest disk that keeps its promises.
    """

    def __init__(self, root: Path) -> None:
        """root: a folder that is on the disk, with all that is in it now."""
        self.root = root
        self._bytes: dict[int, bytes] = {}
        self._names: dict[int, dict[str, int]] = {}
        self._held: list[int] = []
        for path in (root, *root.rglob("*")):
            self._note(path)

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """While it lasts, what is synced is noted."""
        fsync = os.fsync

        def noting(descriptor: int) -> None:
            fsync(descriptor)
            self._note(Path(f"/proc/self/fd/{descriptor}").readlink(), descriptor)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "fsync", noting)
            try:
                yield
            finally:
                for descriptor in self._held:
                    os.close(descriptor)
                self._held.clear()

    def _note(self, path: Path, descriptor: int | None = None) -> None:
        what = path.lstat()
        if descriptor is not None:
            self._held.append(os.dup(descriptor))  # while it is open, no other file gets its number
        if stat.S_ISDIR(what.st_mode):
            self._names[what.st_ino] = {child.name: child.lstat().st_ino for child in path.iterdir()}
        elif stat.S_ISREG(what.st_mode):
            self._bytes[what.st_ino] = path.read_bytes()

    def after_a_cut(self, eager: bool = False) -> dict[str, bytes]:
        """What is found after the power was cut now, by path: nothing that was not synced.

        eager: names reach the disk at once, as on disks that write them first; bytes still do not. A file whose bytes
        were never synced is empty then.
        """
        if eager:
            files = [path for path in self.root.rglob("*") if path.is_file()]
            return {str(f.relative_to(self.root)): self._bytes.get(f.stat().st_ino, b"") for f in files}
        return dict(self._walk(self.root.stat().st_ino, ""))

    def _walk(self, folder: int, prefix: str) -> Iterator[tuple[str, bytes]]:
        for name, number in self._names[folder].items():
            if number in self._names:
                yield from self._walk(number, f"{prefix}{name}/")
            else:
                yield prefix + name, self._bytes.get(number, b"")
