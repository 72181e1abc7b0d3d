"""Bad inputs by the hundred, generated from a seed: recipes, configurations, clips, special files, command lines."""

import os
import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import get_type_hints

import numpy as np

from data_recipes.recipe.character import Recipe
from data_recipes.recipe_paths import RECIPES
from replicate.config import Config

TINY = (RECIPES / "tiny.toml").read_text(encoding="utf-8")
CONFIG = "[coarse]\nmap_size = 64\n[coarse.training]\nsteps = 5\n[lbs]\nbones = [4, 6]\n"
HUGE = "9" * 5_000
GROUPS = ("face", "jaw", "lids", "lips", "handles", "wrinkles", "head", "lid_follow")
NO_CONTROLS = "".join(f"{group} = 0\n" for group in GROUPS)
# As TOML: of no field is any of them a value.
NEVER = {
    "not a number": "nan",
    "infinity": "-inf",
    "a float beyond all": "1e999",
    "a date": "1979-05-27",
    "a number of thousands of digits": HUGE,
    "a hexadecimal of thousands of digits": "0x" + "f" * 5_000,
    "a text of a megabyte less a bit": '"' + "x" * 900_000 + '"',
    "no value": "",
    "a list in a list in a list": "[" * 5_000 + "]" * 5_000,
    "a list of lists": "[[[1]]]",
    "a table": "{ a = 1 }",
    "a list of two kinds": '[1, "two"]',
    "a negative number of thousands of digits": "-" + HUGE,
}
BYTES = {
    "nothing but a NUL": b"\0",
    "a picture": b"\x89PNG\r\n\x1a\n\xff\xfe",
    "UTF-16": "name = 'a'\n".encode("utf-16"),
    "half a character": b'name = "\xc3"\n',
    "two byte order marks": b"\xef\xbb\xbf\xef\xbb\xbfname = 'a'\n",
    "more than is read": b"#" * 1_100_000,
    "brackets without end": b"a = " + b"[" * 900_000,
    "dots without end": b"[" + b"a." * 20_000 + b"a]\n",
    "the same key twice": b"name = 'a'\nname = 'b'\n",
    "a control character": b"name = '\x01'\n",
}


@dataclass(frozen=True)
class Numbers:
    """The numeric keys of a schema: the key's table, its name, and whether it is a list."""

    table: str
    key: str
    many: bool


def numeric_keys(kind: type, table: str = "") -> Iterator[Numbers]:
    """Yield the keys of a Checked class and its sections that hold numbers."""
    hints = get_type_hints(kind)
    for field in fields(kind):
        hint = hints[field.name]
        if is_dataclass(hint):
            yield from numeric_keys(hint, f"{table}.{field.name}".lstrip("."))
        elif table and "range" in field.metadata:
            yield Numbers(table, field.name, hint not in (int, float))


def with_value(text: str, table: str, key: str, value: str) -> str:
    """Return a TOML text in which a key of a table has another value."""
    body = re.compile(rf"(^\[{re.escape(table)}\]\n(?:(?!\[\w+[\w.]*\]\n)[^\n]*\n)*)", re.MULTILINE)
    if not body.search(text):
        return f"{text}\n[{table}]\n{key} = {value}\n"
    without = re.compile(rf"^{key} = (?:\[\n(?:  .*\n)*\]|[^\n]*)\n", re.MULTILINE)
    return body.sub(lambda match: f"[{table}]\n{key} = {value}\n" + without.sub("", match[1].split("\n", 1)[1]), text)


def toml_mutations(text: str, kind: type, generator: np.random.Generator, count: int) -> Iterator[tuple[str, bytes]]:
    """Yield (what is wrong, a TOML file's bytes): every fault that is bad anywhere, at `count` keys drawn from all."""
    for name, data in BYTES.items():
        yield name, data
    keys = list(numeric_keys(kind))
    wrong = {**NEVER, "a text": '"wide"', "true": "true", "far too small": "-1e9", "far too large": "1e12"}
    for index in range(count):
        at = keys[generator.integers(len(keys))]
        name = list(wrong)[index % len(wrong)]
        yield f"{at.table}.{at.key}: {name}", with_value(text, at.table, at.key, wrong[name]).encode()
    for index in range(count // 8):
        at = keys[generator.integers(len(keys))]
        word = at.key + "abcdefgh"[index % 8]
        yield f"unknown key {at.table}.{word}", with_value(text, at.table, word, "1").encode()
        yield f"unknown table {word}", f"{text}\n[{word}]\na = 1\n".encode()
    for index in range(count // 8):
        cut = int(generator.integers(1, len(text)))
        faulty_text = text[:cut] + ("[", '"""', "= =", "\\x")[index % 4] + text[cut:].replace("\n", "\n]\n", 1)
        yield f"broken at {cut}", faulty_text.encode()


def special_files(folder: Path, ending: str) -> dict[str, Path]:
    """Return, by what it is, paths with an ending that are no regular file that can be read."""
    folder.mkdir()
    paths = {
        "a missing file": folder / f"missing{ending}",
        "a long name": folder / f"{'n' * 300}{ending}",
        "a long path": Path("/" + "n/" * 5_000 + f"n{ending}"),
        "a NUL": Path(f"a\0b{ending}"),
    }
    for name in ("folder", "pipe", "device", "endless", "loop", "socket"):
        paths[name] = folder / f"{name}{ending}"
    paths["folder"].mkdir()
    os.mkfifo(paths["pipe"])
    paths["device"].symlink_to("/dev/null")
    paths["endless"].symlink_to("/dev/zero")
    paths["loop"].symlink_to(paths["loop"])
    here = os.getcwd()
    os.chdir(folder)  # a socket's address has at most 107 bytes
    try:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(paths["socket"].name)
    finally:
        os.chdir(here)
    return paths


def clip_mutations(generator: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """Yield (what is wrong, a clip's bytes)."""
    good = "squash,brow_inner_up_left\n" + "0.5,0.25\n" * 20
    yield "empty", b""
    yield "a header alone", b"squash\n"
    yield "a long header", b",".join([b"squash"] * 100_000) + b"\n"
    yield "a long name", b"s" * 200_000 + b"\n0\n"
    yield "a long unknown name", b"s" * 100_000 + b"\n0\n"
    yield "too many frames", b"squash\n" + b"0\n" * 30_000
    yield "empty lines", b"squash\n" + b"\n" * 1_000_000 + b"0\n"
    yield "a quote without end", b'squash\n"0\n' + b"0\n" * 1_000
    for name in ("a picture", "half a character", "nothing but a NUL", "UTF-16"):
        yield name, BYTES[name]
    values = ("nan", "inf", "-2", "2", "one", "", "0x1", HUGE, "1e999", "0;5", "\0", "0.5 0.5", "½")
    for value in values:
        lines = good.splitlines()
        line, column = int(generator.integers(1, len(lines))), int(generator.integers(2))
        cells = lines[line].split(",")
        cells[column] = value
        lines[line] = ",".join(cells)
        yield f"line {line} has {value[:20]!r}", "\n".join(lines).encode()
    for extra in (",0.1", ",", ",0,0,0"):
        yield f"a row ends in {extra!r}", (good + "0,0" + extra + "\n").encode()
    for header in ("squash,wings", "squash,", "squash,squash", "1,2", "Squash,brow_inner_up_left"):
        yield f"the header is {header!r}", good.replace("squash,brow_inner_up_left", header).encode()


def command_lines() -> Iterator[tuple[str, list[str]]]:
    """Yield (what is wrong, the arguments of a command)."""
    run = ["table2", "--profile", "quick", "--characters"]
    for number in ("1.5", "x", "0x3", HUGE, "4294967296", "1e3", "½"):
        yield f"seed {number[:20]!r}", [*run, "tiny", "--seed", number]
    long, home = "n" * 300, "~nobody-of-this-name"
    for name in ("hiccup", "n" * 5_000, "a/b", "..", "tiny.txt", "tiny\0", f"{long}.toml", f"{home}/x.toml", "'a\nb'"):
        yield f"character {name[:20]!r}", [*run, name]
    for profile in ("fast", "", HUGE):
        yield f"profile {profile[:20]!r}", ["table2", "--profile", profile, "--characters", "tiny"]
    for split in ("poses", HUGE):
        yield f"split {split[:20]!r}", [*run, "tiny", "--split", split]
    for jobs in ("0", "-3", "many"):
        yield f"jobs {jobs!r}", [*run, "tiny", f"--jobs={jobs}"]
    for to in ("face.fbx", "/dev/full", "nowhere/at/all/a.glb", f"{home}/a.glb", "a\0.glb", f"{long}.glb"):
        yield f"to {to[:20]!r}", ["export", "--characters", "tiny", "--to", to]
    for recording in (f"{home}/a.csv", "a\0.csv", "/dev/full", f"{long}.csv"):
        yield f"landmarks {recording[:20]!r}", ["capture", "--characters", "tiny", "--landmarks", recording]
    for method in (f"{home}/a.py", "nowhere/a.py", "nearest"):
        yield f"method {method[:20]!r}", [*run, "tiny", "--methods", method]
    for tolerance in ("0", "nan", "inf", "-1", "thin"):
        yield f"tolerance {tolerance}", ["export", "--characters", "tiny", f"--tolerance={tolerance}"]


def recipes(seed: int) -> list[tuple[str, bytes]]:
    """Return bad recipes."""
    generator = np.random.default_rng(seed)
    cases = list(toml_mutations(TINY, Recipe, generator, 120))
    cases += [
        ("empty", b""),
        ("another count of vertices", TINY.replace("vertices = 918", "vertices = 917").encode()),
        ("a name of thousands of letters", TINY.replace('"tiny"', '"' + "t" * 5_000 + '"').encode()),
        ("a clip with a NUL in its name", b'clip_files = ["a\\u0000b.csv"]\n' + TINY.encode()),
        ("a clip with a long name", f'clip_files = ["{"c" * 5_000}.csv"]\n'.encode() + TINY.encode()),
        ("a clip that is a device", b'clip_files = ["/dev/zero"]\n' + TINY.encode()),
        ("teeth of 60 mm", TINY.replace("[teeth]", "[teeth]\nwidths_upper = [60.0, 60.0]").encode()),
        ("limits of no control", TINY.encode() + b'\n[limits]\nfull = ["wings"]\n'),
        ("no controls", (re.sub(r"(?s)\[controls\].*", "[controls]\n", TINY) + NO_CONTROLS).encode()),
    ]
    return cases


def configurations(seed: int) -> list[tuple[str, bytes]]:
    """Return bad configurations."""
    cases = list(toml_mutations(CONFIG, Config, np.random.default_rng(seed), 80))
    zeros = [
        (at.table, at.key) for at in numeric_keys(Config) if at.key in ("steps", "batch", "bins", "count", "hidden")
    ]
    for table, key in zeros:
        value = "[0]" if key == "hidden" else "0"
        cases.append((f"{table}.{key} is zero", with_value(CONFIG, table, key, value).encode()))
    cases += [
        (f"{table}.{key} has zeros too many", with_value(CONFIG, table, key, "70000000").encode())
        for table, key in zeros
        if key == "steps"
    ]
    cases.append(("factors of zero, so that no pose is moved", b"[samples]\nlow = 0.0\nhigh = 0.0\n"))
    return cases
