"""What a stranger would put into a file: values that parsers stumble over."""

from __future__ import annotations

import math
import struct

__all__ = ["CHUNKS", "JSON_VALUES", "LONG", "RAW_JSON", "WORDS", "packed_numbers"]

LONG = "x" * 9_000
"""Longer than a name, a line or a buffer should be."""
ESCAPE = "\x1b]0;owned\x07"
"""What a terminal would take for an order."""
NAMES = (
    "", ".", "..", "../../../../nowhere/x", "/nowhere/x", "..\\..\\x", "C:\\x", "//host/share", "con", "a/../../b", "~",
    "\0", "a\0b", "\ud800", "\u202eexe.png", ESCAPE, "two\nlines", "'\"><script>", "%s%n{0}", "é" * 200, LONG,
)  # fmt: skip
"""Names that lead elsewhere, or that no system has."""
WHOLE = (0, 1, -1, 2, 3, 17, 254, 255, 256, 65_535, 65_536, 2**31 - 1, 2**31, 2**32, -(2**31), 2**53 + 1, 2**63, 2**64)
FRACTIONS = (0.5, -0.0, 1e-300, 5e-324, 1e19, 1e154, 1e308, -1e308, math.nan, math.inf, -math.inf)
JSON_VALUES: tuple[object, ...] = (
    None, True, False, [], {}, [[]], [None], [1, 2, 3], ["a"], {"a": 1}, [1e308] * 16, *WHOLE, *FRACTIONS, *NAMES,
    "1", "nan", "-inf", "1e999", "0x10", "true",
)  # fmt: skip
RAW_JSON = (
    "NaN", "-Infinity", "1e999", "-1e999", "9" * 5000, "-" + "9" * 400, "1." + "3" * 400, "[" * 20_000,
    "[" * 900 + "]" * 900, '{"a":' * 10_000, "tru", "'x'", "01", "+1", ".5", "0x7f", '"\\ud800"', '"\\u0000"', '"\t"', "",
)  # fmt: skip
"""Text in the place of a value; some of it no JSON."""
WORDS: tuple[bytes, ...] = tuple(
    word.encode("utf-8", "surrogatepass")
    for word in (
        "nan", "NaN", "inf", "-inf", "1e999", "-1e999", "1e308", "0", "-1", "1", "0.0", "-0", "1e-320", "9" * 400,
        "9" * 5000, "1_000", "٣", "0x10", "1e400", "65536", "2147483648", "4294967296", "18446744073709551616",
        "99999999999999", "1,5", "-", ".", "#", "//", "{}", "[]", "<a>", "</a>", "<!DOCTYPE a [<!ENTITY b 'c'>]>&b;",
        "&#0;", "<a>" * 500, "2011-13-45 99:99:99", "0000-00-00", *NAMES,
    )
)  # fmt: skip
CHUNKS: tuple[bytes, ...] = (
    b"\x89PNG\r\n\x1a\n", b"IHDR", b"IDAT", b"IEND", b"tRNS", b"PLTE", b"eXIf", b"\xff\xd8", b"\xff\xd9", b"\xff\xda",
    b"\xff\xc0", b"\xff\xc2", b"\xff\xc9", b"\xff\xdd", b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"PK\x06\x06",
    b"\x93NUMPY\x01\x00", b"\x93NUMPY\x02\x00", b"\x93NUMPY\x03\x00", b"'descr': '|O'", b"'shape': (1000000000000,)",
    b"'shape': (-1,)", b"'fortran_order': True", b"ARROW1", b"PAR1", b"\xff\xff\xff\xff", b"\x1f\x8b\x08", b"ply\n",
    b"end_header\n", b"element vertex 1000000000000\n", b"element face -1\n", b"property list uchar int x\n",
    b"property double x\n", b"format ascii 1.0\n", b"format binary_big_endian 1.0\n", b"II*\0", b"MM\0*", b"BM", b"RIFF",
    b"WEBPVP8 ", b"GIF89a", b"acTL", b"fcTL", b"fdAT", b"\0\0\0\x0cjP  \r\n\x87\n", b"jp2c",
    b"\xff\x4f\xff\x51", b"II+\0", b"WEBPVP8X", b"ANIM",
    b"c__builtin__\neval\n", b"cposix\nsystem\n", b"\x80\x04\x95", b"\x80\x05\x96", b"\0" * 64,
    b"\xff" * 64, b"A" * 4096,
)  # fmt: skip
"""Marks of the formats, and orders that a pickle may give."""


def packed_numbers() -> tuple[bytes, ...]:
    """Numbers of all widths and both orders."""
    found: list[bytes] = []
    for order in "<>":
        for layout, bits in (("B", 8), ("H", 16), ("I", 32), ("Q", 64)):
            top = 1 << bits
            found += [
                struct.pack(order + layout, n) for n in (0, 1, top // 2 - 1, top // 2, top - 1, min(top - 1, 100_000))
            ]
        found += [struct.pack(order + kind, n) for kind in "fd" for n in (math.nan, math.inf, -math.inf, -1.0, 3e38)]
    return tuple(dict.fromkeys(found))
