"""Text files of numbers in columns into arrays, checked: what KITTI's and MOTChallenge's files are.

Every error is one line that names the file and, where there is one, its line.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Self

import numpy as np

from mdkf.tables import BoolArray, FloatArray, IntArray

LARGEST = 10**9
"""Largest number that a file may hold, of whatever unit."""

_PLAIN = b"\t\n\r" + bytes(range(ord(" "), 0x7F))
"""What the files may hold: ASCII without control characters. Python takes more than that for
spaces, digits and ends of lines, so that rows and numbers could be others than they seem."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


class KittiError(ValueError):
    """Recorded data that cannot be used; the message is one line and names file and line."""


@dataclass(frozen=True, eq=False)
class TextTable:
    """A file of equally long rows: words by column, and all columns as numbers (0 for words).

    line (n,): row in the file, from 1; numbers (n, columns).
    """

    path: Path
    names: tuple[str, ...]
    line: IntArray
    words: dict[str, list[str]]
    numbers: FloatArray

    @classmethod
    def read(
        cls,
        path: Path,
        names: tuple[str, ...],
        words: tuple[str, ...] = (),
        separator: str | None = None,
    ) -> Self:
        """A file's rows, of columns that spaces, or a separator, keep apart; those of `words` are
        no numbers."""
        rows = [line.split(separator) for line in lines(path)]
        for k, row in enumerate(rows):
            if len(row) != len(names):
                raise KittiError(
                    f"{path}: line {k + 1}: {len(row)} columns, expected {len(names)}:"
                    f" {' '.join(names)}"
                )
        found = {}
        for name in words:
            column = names.index(name)
            found[name] = [row[column] for row in rows]
            for row in rows:
                row[column] = "0"
        numbers = _numbers(path, names, rows)
        return cls(path, names, np.arange(1, len(rows) + 1), found, numbers)

    @staticmethod
    def width(path: Path, separator: str | None = None) -> int:
        """Number of columns of a file's first row; 0 of an empty file."""
        content = lines(path)
        return len(content[0].split(separator)) if content else 0

    def column(self, name: str) -> FloatArray:
        """The values (n,) of a column, 0 for words."""
        return self.numbers[:, self.names.index(name)]

    def refuse(self, bad: BoolArray, name: str, expected: str) -> None:
        """Raise at the first bad row."""
        if bad.any():
            row = int(np.argmax(bad))
            value = self.column(name)[row]
            raise KittiError(
                f"{self.path}: line {self.line[row]}: {name} is {value:g}, expected {expected}"
            )

    def whole(self, name: str, low: int, high: int) -> IntArray:
        """A column of whole numbers from low to high."""
        values = self.column(name)
        bad = (values < low) | (values > high) | (values % 1.0 != 0.0)
        expected = str(low) if low == high else f"a whole number from {low} to {high}"
        self.refuse(bad, name, expected)
        return values.astype(np.int64)

    def sorted_frames(self, n_frames: int) -> None:
        """Refuse a frame that there is not, or that comes before the row above it."""
        frames = self.whole("frame", 0, n_frames - 1)
        falls = np.zeros(len(frames), dtype=np.bool_)
        falls[1:] = np.diff(frames) < 0
        self.refuse(falls, "frame", "frames in ascending order")

    def refuse_repeated(self, name: str) -> IntArray:
        """Identifiers (n,) of a column, whole numbers that are there once in each frame."""
        ids = self.whole(name, 0, LARGEST)
        keys = self.column("frame").astype(np.int64) * (LARGEST + 1) + ids
        repeated = np.ones(len(keys), dtype=np.bool_)
        repeated[np.unique(keys, return_index=True)[1]] = False
        self.refuse(repeated, name, "at most once in a frame")
        return ids

    def take(self, rows: BoolArray) -> Self:
        """Some of the rows, as a mask (n,)."""
        words = {
            name: [word for word, taken in zip(column, rows, strict=True) if taken]
            for name, column in self.words.items()
        }
        return replace(self, line=self.line[rows], words=words, numbers=self.numbers[rows])


def read_bytes(path: Path) -> bytes:
    """A file's content; `KittiError` where it is missing or unreadable."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        missing = next((p for p in (*path.parents[::-1], path) if not p.exists()), path)
        kind = "file" if missing == path else "folder"
        raise KittiError(f"{missing}: no such {kind}") from None
    except OSError as error:
        raise KittiError(f"{path}: cannot be read: {error.strerror}") from None


def lines(path: Path) -> list[str]:
    """The lines of a file of plain text; `KittiError` at the first that is none."""
    content = read_bytes(path)
    if content.translate(None, _PLAIN):
        try:
            content.decode("utf-8")
        except UnicodeDecodeError:
            raise KittiError(f"{path}: is not UTF-8 text") from None
        for k, line in enumerate(content.splitlines()):
            if strange := line.translate(None, _PLAIN):
                raise KittiError(
                    f"{path}: line {k + 1}: holds {strange.decode()[0]!a},"
                    " expected ASCII without control characters"
                )
    return content.decode("ascii").splitlines()


def _numbers(path: Path, names: Sequence[str], rows: list[list[str]]) -> FloatArray:
    """Rows of words as numbers (rows, columns)."""
    words = list(chain.from_iterable(rows))
    try:
        numbers = np.fromiter(map(float, words), np.float64, len(words))
    except ValueError:
        numbers = np.full(len(words), np.nan)
    # Python takes 1_000 for a number, too.
    if not (np.abs(numbers) <= LARGEST).all() or "_" in "".join(words):
        for k, row in enumerate(rows):
            for name, word in zip(names, row, strict=True):
                if not is_number(word):
                    raise KittiError(
                        f"{path}: line {k + 1}: {name} is {word[:40]!r}, expected a number"
                    )
    return numbers.reshape(len(rows), len(names))


def is_number(word: str) -> bool:
    """Whether a word is a finite number that files of measurements may hold."""
    return _NUMBER.fullmatch(word) is not None and abs(float(word)) <= LARGEST
