"""Spoiled files and arguments, what is asked of whoever reads them, and the tally of what was tried.

The suite runs a few dozen cases per reader, the same ones every time. ``scripts/fuzz`` runs many more with other seeds: it sets
``MJSIM_FUZZ`` (factor on the number of cases) and ``MJSIM_FUZZ_TABLE`` (file that gets the tally).
"""

import json
import os
import signal
import tempfile
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from mjsim.errors import InputError

FACTOR = int(os.environ.get("MJSIM_FUZZ", "1"))
#: (what was read or run, ``accepted``, ``refused`` or ``usage``) -> cases.
TALLY: Counter = Counter()
#: No reader may take longer than this for a file of ordinary size, s.
PATIENCE = 20

settings.register_profile(
    "mjsim",
    derandomize=FACTOR == 1,
    database=None,
    deadline=None,
    print_blob=FACTOR > 1,
    # fixtures are folders that every case leaves as they were; spoiled files are large on purpose
    suppress_health_check=[
        HealthCheck.function_scoped_fixture,
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
    ],
)


def cases(number):
    """How many cases a property is tried on."""
    return settings(max_examples=number * FACTOR)


def write_tally():
    """Add the tally to the file that ``scripts/fuzz`` reads."""
    path = os.environ.get("MJSIM_FUZZ_TABLE")
    if path and TALLY:
        with open(path, "a") as file:
            for (what, outcome), count in TALLY.items():
                file.write(json.dumps([what, outcome, count]) + "\n")


class Hang(BaseException):
    """Something took longer than :data:`PATIENCE`."""


@contextmanager
def patience(seconds=PATIENCE):
    """Stop what hangs: a FIFO without a writer, a search without an end."""

    def stop(*_):
        raise Hang(f"still at it after {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def sentence(error, *names):
    """What is asked of an :class:`InputError`: one sentence of bounded length that names the file."""
    text = " ".join(str(error).split())
    assert 10 < len(text) < 690, text[:1000]
    assert "Traceback" not in text and "\n" not in str(error).strip(), text
    assert any(str(n) in text for n in names), (text, names)
    return text


def tried(what, read, path, *others):
    """Read a spoiled file: what came out, or ``None`` where one sentence refused it."""
    with patience():
        try:
            value = read(path)
        except InputError as error:
            sentence(error, Path(path).name, *others)
            TALLY[what, "refused"] += 1
            return None
    TALLY[what, "accepted"] += 1
    return value


# -- what is put in place of a number, a word, a line ------------------------------------------------------------------------------

NUMBERS = (
    b"nan", b"-nan", b"inf", b"-inf", b"Infinity", b"-0", b"-0.0", b"0", b"1e400", b"-1e400", b"1e308", b"-1e308", b"1e-320", b"1e18",
    b"1e30", b"1" + b"0" * 400, b"9" * 5000, b"0x10", b"0o7", b"1_000", b"1__0", b".5", b"5.", b"+5", b"--5", b"1,5", b"1.2.3", b"1e",
    b"e5", b"", b" ", b"\xd9\xa3", b"\xc2\xb2", b"\xef\xbc\x95", b"true", b"null", b'"5"', b"'x'", b"[1]", b"[]", b"{}", b"{a = 1}",
    b"1979-05-27", b"07:32:00", b"1e-9", b"-1", b"99999999", b"4294967296", b"-9223372036854775809", b"text", b"\\", b"\x1b[31m", b"\x00",
    b"\xff",
)  # fmt: skip
WORDS = (
    b'""', b'" "', b'"."', b'".."', b'"/"', b'"../../../etc/passwd"', b'"/etc/passwd"', b'"/dev/zero"', b'"~"', b'"\\u0000"',
    b'"\\u001b[2J"', b'"\\n"', b"'" + b"x" * 3000 + b"'", b'"\xc3\xa9\xe2\x86\x92"', b'"\\ud800"', b'"%s%n{0}"', b'"campaign.toml"',
    b'"traces"', b"5", b"true", b"[]", b'["a"]', b"{}", b"nan", b'"nul"', b'"."""', b"'''", b'"loop"', b'"fifo"', b'"a/b/c/d/e"',
    b'"' + b"a/" * 600 + b'"',
)  # fmt: skip
JUNK = (
    b"\x00", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\x1a", b"\x0b\x0c", b"\xe2\x80\xa8", b"\xc2\x85", b"\t", b'"', b"'", b"[",
    b"]", b"{", b"[[", b"]]", b"=", b"#", b",", b";", b"\\", b"(", b")", b"%", b"<", b">", b"&", b"&a;", b"<![CDATA[", b"<!--",
    b"\xf0\x9f\x98\x80", b"[" * 3000, b"(" * 3000, b"<a>" * 3000, b"{" * 3000, b'"' * 30, b"a." * 3000 + b"a=1\n", b"x" * 100_000,
    b"1" * 100_000, b" " * 100_000, b"\n" * 10_000, b"," * 100_000, b"-" * 10_000, b"\t" * 10_000 + b"x", b"_" * 10_000, b"1.1" * 10_000,
)  # fmt: skip


def _token(data, rng, pattern, new):
    import re

    spots = [m.span() for m in re.finditer(pattern, data)]
    if not spots:
        return data
    a, b = spots[rng(len(spots) - 1)]
    return data[:a] + new + data[b:]


@st.composite
def spoiled(draw, data, most=2):
    """``data`` (bytes) after one to ``most`` accidents: of bytes, lines, numbers, words, encodings."""
    for _ in range(draw(st.integers(1, most))):
        data = draw(_accident(data))
    return data


@st.composite
def _accident(draw, data):
    rng = lambda top: draw(st.integers(0, max(0, top)))  # noqa: E731
    pick = lambda options: draw(st.sampled_from(options))  # noqa: E731
    kind = pick(
        ("flip", "cut", "insert", "delete", "twice", "number", "number", "number", "word", "word", "drop line", "double line", "swap lines",
         "reverse", "shuffle", "encode", "line ends", "key", "whole")
    )  # fmt: skip
    lines = data.split(b"\n")
    i, j = rng(len(lines) - 1), rng(len(lines) - 1)
    at = rng(len(data))
    if kind == "flip":
        return data[:at] + bytes([rng(255)]) + data[at + 1 :]
    if kind == "cut":
        return data[:at]
    if kind == "insert":
        return data[:at] + pick(JUNK) + data[at:]
    if kind == "delete":
        return data[:at] + data[at + 1 + rng(60) :]
    if kind == "twice":
        return data[:at] + data[at : at + 200] * (1 + rng(40)) + data[at:]
    if kind == "number":
        return _token(data, rng, rb"(?<![A-Za-z_\d.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?", pick(NUMBERS))
    if kind == "word":
        return _token(data, rng, rb'"[^"\n]*"', pick(WORDS))
    if kind == "drop line":
        return b"\n".join(lines[:i] + lines[i + 1 :])
    if kind == "double line":
        return b"\n".join(lines[: i + 1] + lines[i:])
    if kind == "swap lines":
        lines[i], lines[j] = lines[j], lines[i]
        return b"\n".join(lines)
    if kind == "reverse":
        a, b = sorted((i, j))
        return b"\n".join(lines[:a] + lines[a:b][::-1] + lines[b:])
    if kind == "shuffle":
        return b"\n".join(lines[i:] + lines[:i])
    if kind == "encode":
        text = data.decode("utf-8", "replace")
        name = pick(("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "utf-32", "utf-7", "cp1252", "cp037"))
        return text.encode(name, "replace")
    if kind == "line ends":
        return data.replace(b"\n", pick((b"\r\n", b"\r", b"\n\n", b"\n\r", b"\n \n", b"\x0b\n", b"\xe2\x80\xa8", b"")))
    if kind == "key":
        return _token(
            data,
            rng,
            rb"(?m)^[A-Za-z_]\w*(?= *=)",
            pick((b"a.b.c", b"name", b'""', b"'x y'", b"__class__", b"kind", b"\xc3\xa9", b"= ", b"a" * 3000)),
        )
    return pick(
        (
            b"",
            b"\n",
            b"\x00" * 3000,
            data * 2,
            bytes(range(256)) * 8,
            b"\x1f\x8b" + data,
            b"PK\x03\x04" + data,
            b"{}",
            b"[]",
            b"<a/>",
            data[::-1],
        )
    )


@contextmanager
def replaced(path, data):
    """A file with other content for a while; the file itself and its folder are as before afterwards."""
    former = path.read_bytes() if path.exists() else None
    path.write_bytes(data)
    try:
        yield path
    finally:
        if former is None:
            path.unlink(missing_ok=True)
        else:
            path.write_bytes(former)


def odd_places(folder):
    """What can stand where a file is expected, in an empty ``folder``: name -> path."""
    folder = Path(folder)
    out = {"nothing": folder / "nothing.x", "a folder": folder / "folder.x", "a link to itself": folder / "loop.x"}
    out["a link to nothing"], out["a FIFO"], out["below a file"] = folder / "dangling.x", folder / "fifo.x", folder / "plain.x" / "below.x"
    out["an endless device"], out["a name too long"] = folder / "zero.x", folder / ("n" * 300 + ".x")
    out["a path too long"] = folder / ("d/" * 3000) / "x.x"
    (folder / "folder.x").mkdir()
    (folder / "loop.x").symlink_to("loop.x")
    (folder / "dangling.x").symlink_to("gone")
    os.mkfifo(folder / "fifo.x")
    (folder / "plain.x").write_text("plain")
    (folder / "zero.x").symlink_to("/dev/zero")
    if os.geteuid():
        out["no permission"] = folder / "secret.x"
        (folder / "secret.x").write_text("secret")
        (folder / "secret.x").chmod(0)
    return out


def scratch():
    """A new temporary folder."""
    return Path(tempfile.mkdtemp(prefix="mjsim-fuzz-"))
