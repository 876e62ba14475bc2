"""KITTI lines as recorders write them, the ways in which lines get spoilt, and a grammar that says
what is wrong with a line.

The grammar shares nothing with the reader: it is written down as regular expressions on bytes.
"""

import re
from collections.abc import Callable
from random import Random

BOX = ("h", "w", "l", "x", "y", "z", "ry")
IMAGE = ("alpha", "x1", "y1", "x2", "y2")
LABEL = ("frame", "track_id", "type", "truncated", "occluded", *IMAGE, *BOX)
DETECTION = ("frame", "type", "truncated", "occluded", *IMAGE, *BOX, "score")
POSE = ("frame", *("r11", "r12", "r13", "t1", "r21", "r22", "r23", "t2", "r31", "r32", "r33", "t3"))
SEQUENCE = ("sequence", "filler", "first", "frames")

OBJECTS = (b"Car", b"Van")
TYPES = (*OBJECTS, *b"Truck Pedestrian Person Person_sitting Cyclist Tram Misc DontCare".split())
LARGEST = 1e9

# --- the grammar ------------------------------------------------------------------------------

_END = re.compile(rb"\r\n|\r|\n")
_TEXT = re.compile(rb"[\t -~]*")
_WORD = re.compile(rb"[^\t ]+")
_NUMBER = re.compile(rb"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


def lines_of(content: bytes) -> list[bytes]:
    """The lines of a file, however they end."""
    lines = _END.split(content)
    return lines if lines[-1] else lines[:-1]


def words_of(line: bytes) -> list[bytes]:
    return _WORD.findall(line)


def is_text(content: bytes) -> bool:
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def number(word: bytes) -> float | None:
    """What a word says, if it is a number that may be in a file."""
    if _NUMBER.fullmatch(word) and abs(value := float(word)) <= LARGEST:
        return value
    return None


def faults_of(line: bytes, names: tuple[str, ...], n_frames: int) -> set[str]:
    """What is wrong with a line by itself: `text`, `columns`, or the names of columns."""
    if not _TEXT.fullmatch(line):
        return {"text"}
    words = words_of(line)
    if len(words) != len(names):
        return {"columns"}
    word = dict(zip(names, words, strict=True))
    kind = word.pop("type", b"Car")
    word = {name: w for name, w in word.items() if name not in ("sequence", "filler")}
    numbers = {name: number(w) for name, w in word.items()}
    value = {name: v for name, v in numbers.items() if v is not None}
    faults = numbers.keys() - value.keys()
    whole = {"frame": (0, n_frames - 1), "first": (0, 0), "frames": (1, LARGEST)}
    if kind not in TYPES:
        faults.add("type")
    if kind in OBJECTS:
        whole |= {"track_id": (0, LARGEST), "truncated": (-1, 2), "occluded": (-1, 3)}
        faults |= {name for name in "hwl" if value.get(name, 1.0) <= 0.0}
    for name in whole.keys() & value.keys():
        low, high = whole[name]
        if not low <= value[name] <= high or value[name] % 1.0:
            faults.add(name)
    return faults


def faults_in(lines: list[bytes], names: tuple[str, ...], n_frames: int) -> list[set[str]]:
    """What is wrong with each line of a file: also frames that fall, and what is there twice."""
    faults = [faults_of(line, names, n_frames) for line in lines]
    latest, seen = 0.0, set()
    for line, wrong in zip(lines, faults, strict=True):
        if wrong:
            continue
        word = dict(zip(names, words_of(line), strict=True))
        frame = float(word.get("frame", b"0"))
        if frame < latest:
            wrong.add("frame")
        latest = frame
        for name in {"sequence", "track_id"} & word.keys():
            if word.get("type", b"Car") in OBJECTS:
                key = frame, word[name] if name == "sequence" else float(word[name])
                if key in seen:
                    wrong.add(name)
                seen.add(key)
    return faults


# --- lines as they should be --------------------------------------------------------------------


def sound(rng: Random, names: tuple[str, ...], n_frames: int) -> list[bytes]:
    """The words of a line, as recorders print them."""
    if names == SEQUENCE:
        return [b"%04d" % rng.randrange(10**4), b"empty", b"000000", b"%06d" % rng.randint(1, 999)]
    word: dict[str, bytes] = {name: b"%.6f" % rng.uniform(-1000, 1000) for name in names}
    word["frame"] = b"%d" % rng.randrange(n_frames)
    if names == POSE:
        for name in names[1:]:
            if name[0] == "r":
                word[name] = b"%.6f" % (name[1] == name[2])
        return list(word.values())
    word["type"] = rng.choice(TYPES) if rng.random() < 0.3 else rng.choice(OBJECTS)
    word["truncated"], word["occluded"] = b"%d" % rng.randint(-1, 2), b"%d" % rng.randint(-1, 3)
    word |= {name: b"%.4f" % rng.uniform(0.1, 12.0) for name in "hwl"}
    word["ry"] = b"%.6f" % rng.uniform(-3.2, 3.2)
    if "track_id" in word:
        word["track_id"] = b"%d" % rng.randrange(10**6)
    return list(word.values())


# --- what happens to them -----------------------------------------------------------------------

EXTREME = b"""0 -0 -0.0 +0 00 0e0 1 1.0 -1 2 +3 007 0.5 .5 5. -.5 5.e-1 1E3 1e+3 1e9 -1e9 1000000000
    1000000000.0000001 -999999999.9999999 1e-9 1e-300 5e-324 -5e-324 1e-400 3.141592653589793
    """.split()
"""Numbers that are allowed in some column at least."""

NO_NUMBER = [
    *b"""1000000001 1e10 -1e10 1e300 1e308 1e309 -1e309 1e999999999 9223372036854775808 nan NaN -nan
    -nan(ind) inf -Inf infinity 1.#INF 1.#QNAN 0x10 0x1p3 1_000 1__0 _1 1_ 1,5 1.000,5 1.5f 1d3 1e
    e5 1e+ . - + +- --1 1..2 1.2.3 1-2 None null True true '1' "1" 1; 1) () #1 ? Car Cat \\ % %s {}
    """.split(),
    *(text.encode() for text in ("١٢", "１２", "½", "²", "−1", "1\u00a0000", "1\u20091", "٣.٥")),
]
LONG = [
    *(b"0" * 5000 + b"1", b"1." + b"0" * 5000, b"0." + b"3" * 5000, b"1e-" + b"9" * 400),
    *(b"1" * 400, b"1e" + b"9" * 400, b"x" * 10_000, b"_" * 10_000),
]
BYTES = [bytes([b]) for b in range(256)] + [
    text.encode() for text in ("\ufeff", "\u00a0", "\u0085", "\u2028", "\u3000", "\u0661", "é")
]


def _one_word(rng: Random, words: list[bytes], odd: list[bytes]) -> bytes:
    words[rng.randrange(len(words))] = rng.choice(odd)
    return b" ".join(words)


def _swapped(rng: Random, words: list[bytes]) -> bytes:
    i, j = rng.randrange(len(words)), rng.randrange(len(words))
    words[i], words[j] = words[j], words[i]
    return b" ".join(words)


def _one_less(rng: Random, words: list[bytes]) -> bytes:
    del words[rng.randrange(len(words))]
    return b" ".join(words)


def _one_more(rng: Random, words: list[bytes]) -> bytes:
    words.insert(rng.randrange(len(words) + 1), rng.choice(words))
    return b" ".join(words)


def _cut_off(rng: Random, words: list[bytes]) -> bytes:
    line = b" ".join(words)
    return line[: rng.randrange(len(line))]


def _flipped_bit(rng: Random, words: list[bytes]) -> bytes:
    line = bytearray(b" ".join(words))
    line[rng.randrange(len(line))] ^= 1 << rng.randrange(8)
    return bytes(line)


def _byte_too_much(rng: Random, words: list[bytes]) -> bytes:
    line = b" ".join(words)
    at = rng.choice((0, len(line), rng.randrange(len(line))))
    return line[:at] + rng.choice(BYTES) + line[at:]


def _other_spaces(rng: Random, words: list[bytes]) -> bytes:
    spaces = (b" ", b"  ", b"\t", b" \t ", b"", b"\x0b", b"\x1f", b"\r")
    likely = (60, 9, 9, 9, 1, 1, 1, 1)
    gaps = rng.choices(spaces, likely, k=len(words))
    return b"".join(gap + word for gap, word in zip(gaps, words, strict=True))


def _other_end(rng: Random, words: list[bytes]) -> bytes:
    return b" ".join(words) + rng.choice((b"\r", b" ", b"\t\r", b"\n", b"\r\r", b"\x1a", b"\x00"))


def _twice(rng: Random, words: list[bytes]) -> bytes:
    line = b" ".join(words)
    return line + rng.choice((b"\n", b" ", b"", b"\r\n")) + line


def _any_bytes(rng: Random, words: list[bytes]) -> bytes:
    return rng.randbytes(rng.randrange(80))


def _any_words(rng: Random, words: list[bytes]) -> bytes:
    return b" ".join(rng.choices(EXTREME + NO_NUMBER + [*TYPES], k=len(words)))


MUTATIONS: tuple[Callable[[Random, list[bytes]], bytes], ...] = (
    lambda rng, words: _one_word(rng, words, EXTREME),
    lambda rng, words: _one_word(rng, words, NO_NUMBER),
    lambda rng, words: _one_word(rng, words, LONG),
    *(_swapped, _one_less, _one_more, _cut_off, _flipped_bit, _byte_too_much),
    *(_other_spaces, _other_end, _twice, _any_bytes, _any_words),
)
LIKELY = (6, 6, 0.2, 3, 1, 1, 2, 3, 3, 3, 1, 1, 1, 1)


def spoilt(rng: Random, words: list[bytes]) -> bytes:
    """A line after something happened to its words, or to the line."""
    (mutation,) = rng.choices(MUTATIONS, LIKELY)
    return mutation(rng, list(words))
