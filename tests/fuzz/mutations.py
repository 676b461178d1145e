"""Damage to bytes and to text that any target may use; every choice is the generator's."""

import random
import re
from collections.abc import Callable, Iterable

#: Numbers at which arithmetic, limits and parsers break.
EXTREMES = [
    "0", "-0.0", "1", "-1", "2", "1e308", "-1e308", "1.7976931348623157e308", "1e400", "-1e400", "1e-308", "5e-324",
    "1e-400", "1e110", "1e-110", "1e30", "1e-30", "1e16", "nan", "inf", "-inf", "+nan", "2147483647", "2147483648",
    "4294967294", "4294967296", "9223372036854775807", "9223372036854775808", "18446744073709551616",
    "-9223372036854775809", "123456789012345678901234567890", "0.1", "1e3", "1e6", "1e9", "1e-3", "1e-9", "0.5",
    "0.999999", "1.0000000000000002", "0x7fffffff", "0o17", "0b11", "1_000", "-3", "200..0", "1e", "1e+", ".5", "5.",
    "1,5", "--1", "++1", "1e5000", "00", "01", "1e-5000",
]  # fmt: skip
_NUMBER = re.compile(rb"(?<![\w.])[-+]?\d[\d_]*(?:\.\d+)?(?:[eE][-+]?\d+)?")
_STRANGE = [
    b"\0", b"\r", b"\n", b"\r\n", b"\t", b"\v", b"\f", b"\x1b[31m", b"\x7f", b"\xff", b"\xfe\xff", b"\xc3", b"\xc0\x80",
    "\ufeff".encode(), "\u202e".encode(), "\u2028".encode(), "\x85".encode(), "\U0001f600".encode(), b'"', b"'", b"\\",
    b"[", b"]", b"{", b"}", b"#", b"=", b",", b".", b";", b":", b" ", b"-", b"%s", b"{0}", b"\\u0000", b"A" * 300,
]  # fmt: skip


def replaced(
    rng: random.Random, content: bytes, matches: Iterable[re.Match[bytes]], new: Callable[[re.Match[bytes]], bytes],
    group: int = 0,
) -> bytes:  # fmt: skip
    """The text with another in the place of one of the matches, or of a group of it."""
    if not (found := list(matches)):
        return content
    chosen = rng.choice(found)
    return content[: chosen.start(group)] + new(chosen) + content[chosen.end(group) :]


def with_extreme_number(rng: random.Random, content: bytes) -> bytes:
    """The text with one of its numbers replaced by one at which things break."""
    return replaced(rng, content, _NUMBER.finditer(content), lambda _: rng.choice(EXTREMES).encode())


def with_other_line(rng: random.Random, content: bytes) -> bytes:
    """One line left out, twice, or in the place of another."""
    lines = content.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(3):
        case 0:
            del lines[one]
        case 1:
            lines.insert(other, lines[one])
        case 2:
            lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


def _flip(rng: random.Random, content: bytes) -> bytes:
    at = rng.randrange(len(content))
    return content[:at] + bytes([content[at] ^ (1 << rng.randrange(8))]) + content[at + 1 :]


def _byte(rng: random.Random, content: bytes) -> bytes:
    at = rng.randrange(len(content))
    return content[:at] + bytes([rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))]) + content[at + 1 :]


def _insert(rng: random.Random, content: bytes) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(_STRANGE) + content[at:]


def _span(rng: random.Random, content: bytes) -> tuple[int, int]:
    at = rng.randrange(len(content))
    return at, min(len(content), at + 1 + int(rng.expovariate(1 / 30)))


def _drop(rng: random.Random, content: bytes) -> bytes:
    begin, end = _span(rng, content)
    return content[:begin] + content[end:]


def _repeat(rng: random.Random, content: bytes) -> bytes:
    begin, end = _span(rng, content)
    return content[:end] + content[begin:end] * rng.choice((1, 1, 2, 50)) + content[end:]


def _cut(rng: random.Random, content: bytes) -> bytes:
    return content[: rng.randrange(len(content))]


def _move(rng: random.Random, content: bytes) -> bytes:
    begin, end = _span(rng, content)
    rest = content[:begin] + content[end:]
    at = rng.randrange(len(rest) + 1)
    return rest[:at] + content[begin:end] + rest[at:]


_DAMAGES: list[Callable[[random.Random, bytes], bytes]] = [
    _flip, _byte, _insert, _drop, _repeat, _cut, _move, with_extreme_number,
]  # fmt: skip


def damaged_bytes(rng: random.Random, content: bytes, most: int = 4) -> bytes:
    """The content after one to a few small damages."""
    for _ in range(rng.randint(1, most)):
        if content:
            content = rng.choice(_DAMAGES)(rng, content)
    return content
