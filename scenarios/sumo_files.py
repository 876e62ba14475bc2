"""Reads SUMO's XML files with care: they are a user's, and SUMO's own parser follows them anywhere.

Refused are document types and includes (they reach other files, or expand without end) and every
encoding but UTF-8 (in which those could hide).
"""

import math
from pathlib import Path
from xml.etree import ElementTree

MAX_SIZE = 500_000_000  # bytes; the network of a large city is half of this


def read_bytes(path: Path, error: type[ValueError]) -> bytes:
    """The contents of a regular file up to `MAX_SIZE`; raises `error` (one line) otherwise."""
    try:
        if path.exists() and not path.is_file():
            raise error(f"{path}: is not a regular file")
        if path.stat().st_size > MAX_SIZE:
            raise error(f"{path}: is larger than {MAX_SIZE} bytes")
        return path.read_bytes()
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}") from None


def parse_xml(path: Path, content: bytes, error: type[ValueError]) -> ElementTree.Element:
    """The root of an XML document; `path` is named in the message of the `error` raised."""
    if content.startswith(b"\x1f\x8b"):
        raise error(f"{path}: is compressed; unpack it")
    # Other encodings would hide what is looked for below.
    if b"\0" in content[:4096] or content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise error(f"{path}: is not UTF-8 text")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise error(f"{path}: a document type declaration (<!DOCTYPE) is not accepted")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError) as problem:
        raise error(f"{path}: is not well-formed XML: {problem}") from None
    except RecursionError:
        raise error(f"{path}: is nested too deeply") from None
    if root.find(".//include") is not None:
        raise error(f"{path}: <include> is not accepted; give each file in the configuration")
    return root


def seconds(text: str) -> float:
    """A time as SUMO writes it, seconds or [days:]hours:minutes:seconds, in seconds.

    Raises `ValueError` for anything else.
    """
    *larger, last = text.strip().split(":")
    total = math.nan
    try:
        if len(larger) in (0, 2, 3):
            units = zip(reversed(larger), (60, 3600, 86_400), strict=False)
            total = float(last) + sum(int(value) * unit for value, unit in units)
    except ValueError:
        pass
    if not abs(total) < 1e9:
        raise ValueError(f"{text[:60]!r} is no time")
    return total
