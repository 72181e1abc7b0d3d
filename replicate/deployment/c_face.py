"""Our regional method of one character as a C99 file and its header: no library but libm, and nothing is allocated.

Weights stay floats of 16 bits and bases integers of 8 or 16, as on disk. As floats of 32 bits they would take three
times the memory and no less time: most of a pose's time goes into reading them.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import nn

from data_recipes.rig import Control
from replicate.approximation.rigid import Attachments
from replicate.geometry.mesh import Mesh
from replicate.regional.model import RegionalModel, StoredBasis
from replicate.regional.networks import SLOPE

LETTER = 79  # small numbers of 8 bits become capitals, which take one character where others take four
HALF_BIAS = 112  # the exponent of a float less that of a 16-bit float
LARGEST_HALF = 65504.0
LIMITS = ("least", "most")  # bounds of the hidden layers' outputs
FOLDER = Path(__file__).parent / "c"
TEMPLATES = (FOLDER / "face.h", FOLDER / "face.c")  # the arithmetic is plain C, and what belongs to a face is a $word
NOTHING = [["0"]]  # C has no empty arrays


@dataclass(frozen=True)
class CFace:
    """What a character's C files are written from.

    name: the character, as part of C's names
    controls: the rig's, in their order
    mesh: the neutral mesh and its segments
    attachments: what places the rigid segments
    model: the approximation
    mesh_file: where the mesh lies, in words
    about: what the files are, in a few lines
    licence: what may be done with them, in a few lines
    """

    name: str
    controls: Sequence[Control]
    mesh: Mesh
    attachments: Attachments
    model: RegionalModel
    mesh_file: str
    about: str
    licence: str


def c_files(face: CFace, stem: str) -> dict[str, str]:
    """Return the texts of the header and of the source by their names, stem.h and stem.c."""
    words = _words(face, stem)
    return {f"{stem}{file.suffix}": Template(file.read_text(encoding="ascii")).substitute(words) for file in TEMPLATES}


def identifier(text: str) -> str:
    """Return a text as a name in C: letters, digits and _, no digit first."""
    word = re.sub(r"\W", "_", text, flags=re.ASCII)
    return f"_{word}" if word[:1].isdigit() else word


def _words(face: CFace, stem: str) -> dict[str, object]:
    name, networks, mesh = identifier(face.name).lower(), face.model.network.networks, face.mesh
    tables, arrays = _networks(face.model)
    regions, shapes = _regions(face)
    rigid, placed = _rigid(mesh, face.attachments)
    widest = max(layer.out_features for network in networks for layer in network.layers)
    coefficients = sum(network.output.out_features for network in networks)
    longest = 3 * max(region[0] for region in regions)
    arrays += [*shapes, *placed, *tables, *_tables(regions, rigid)]
    limits = [(c.lower, c.default, c.upper) for c in face.controls]
    guard = f"{identifier(stem).upper()}_H"
    return {
        "name": name,
        "upper": name.upper(),
        "guard": guard,
        "header": f"{stem}.h",
        "source": f"{stem}.c",
        "mesh": face.mesh_file,
        "about": in_comment(face.about),
        "licence": in_comment(face.licence),
        "controls": len(face.controls),
        "vertices": len(mesh.neutral),
        "segments": len(mesh.segment_names),
        "enum": ",\n".join(f"    {n}" for n in _enumerators(name.upper(), face.controls, guard)),
        "stack_kb": -(-4 * (2 * len(face.controls) + 2 * widest + coefficients + longest) // 1000),
        "letter": LETTER,
        "gated": int(networks[0].is_gated),
        "slope": float_number(SLOPE),
        "networks": len(networks),
        "layers": len(networks[0].layers),
        "coefficients": coefficients,
        "regions": len(regions),
        "rigid": len(face.attachments.segment),
        "widest": widest,
        "longest": longest,
        "control_table": structures(
            (quoted(control.name), quoted(control.region), *map(float_number, values))
            for control, values in zip(face.controls, limits, strict=True)
        ),
        "segment_names": ",\n".join(f"    {quoted(segment)}" for segment in mesh.segment_names),
        "numbers": "\n".join(arrays),
    }


def _enumerators(prefix: str, controls: Sequence[Control], guard: str) -> list[str]:
    """Return a different name for each control; those that C can't tell apart get the control's index at their end.

    Words in capitals that the C files have themselves, such as AT_ONCE and FLT_MAX, are taken.
    """
    names = [f"{prefix}_{identifier(control.name).upper()}" for control in controls]
    own = (file.read_text(encoding="ascii").replace("${upper}", prefix) for file in TEMPLATES)
    taken = {word for text in own for word in re.findall(r"\b[A-Z_][A-Z0-9_]*\b", text)} | {guard}
    alike = taken | {name for name in names if names.count(name) > 1}
    known = taken | set(names)
    found = []
    for i, name in enumerate(names):
        if name in alike:
            while name in known:
                name = f"{name}_{i}"
            known.add(name)
        found.append(name)
    return found


def _networks(model: RegionalModel) -> tuple[list[str], list[str]]:
    """Return the table of C's networks with those of their layers, and the arrays that they point to."""
    rows, tables, arrays = [], [], [float_list("scale", model.scale.numpy())]
    for k, (network, seen) in enumerate(zip(model.network.networks, model.network.seen, strict=True)):
        names = [f"layer_{k}_{i}" for i in range(len(network.layers))]
        hidden = [_layer(name, layer) for name, layer in zip(names, network.layers, strict=True)]
        last, line = _layer(f"last_{k}", network.output), _layer(f"line_{k}", network.line)
        arrays += [index_list(f"seen_{k}", seen.numpy())]
        bounds = {"lowest": network.lowest, "highest": network.highest}
        bounds |= {name: torch.cat(ends) for name, ends in zip(LIMITS, zip(*network.limits, strict=True), strict=True)}
        arrays += [float_list(f"{name}_{k}", _finite(values)) for name, values in bounds.items()]
        arrays += [array for _, of_layer in (*hidden, last, line) for array in of_layer]
        tables.append(f"static const layer layers_{k}[] = {{\n{structures(row for row, _ in hidden)}}};\n")
        ends = (f"{{{', '.join(row)}}}" for row, _ in (last, line))
        rows.append([str(len(seen)), f"seen_{k}", *(f"{name}_{k}" for name in bounds)])
        rows[-1] += [f"layers_{k}", *ends]
    return [*tables, f"static const network networks[] = {{\n{structures(rows)}}};\n"], arrays


def _finite(values: torch.Tensor) -> np.ndarray:
    """Return bounds that C can write: infinity becomes the largest float."""
    largest = np.finfo(np.float32).max
    return np.clip(values.numpy(), -largest, largest)


def _layer(name: str, layer: nn.Linear | None) -> tuple[list[str], list[str]]:
    """Return a layer's row and arrays. Weights, [in, out], are scaled by a power of two, so that none is subnormal."""
    if layer is None:
        return ["0", "0", "0.0f", "0", "0", "0"], []
    weight = layer.weight.detach().cpu().numpy().astype(np.float32).T
    largest = float(np.abs(weight).max(initial=0.0)) or 1.0
    exponent = int(np.floor(np.log2(LARGEST_HALF / largest)))
    bits = np.ldexp(weight, exponent).astype(np.float16).view(np.uint16)
    arrays = [byte_rows(f"{name}_high", (bits >> 8).astype(np.uint8)), byte_rows(f"{name}_low", bits.astype(np.uint8))]
    bias = "0"
    if layer.bias is not None:
        bias = f"{name}_bias"
        arrays.append(float_list(bias, layer.bias.detach().cpu().numpy()))
    unit = float_number(2.0 ** (HALF_BIAS - exponent))
    row = [str(layer.in_features), str(layer.out_features), unit, bias, f"{name}_high[0]", f"{name}_low[0]"]
    return row, arrays


def _regions(face: CFace) -> tuple[list[tuple], list[str]]:
    """Return the rows of C's regions and their arrays."""
    start, model, steps = face.mesh.neutral.astype(np.float64), face.model, []
    rows, arrays = [], []
    for k, basis in enumerate(model.bases):
        members = basis.vertices.numpy()
        start[members] += basis.means().numpy()
        shapes, shape_arrays = _shapes(k, basis)
        counts = (len(members), len(basis.fine), len(basis.rough))
        rows.append((*counts, f"members_{k}", f"weights_{k}", *shapes))
        arrays += [index_list(f"members_{k}", members), float_list(f"weights_{k}", basis.weights.numpy())]
        arrays += shape_arrays
        steps.append(basis.steps.numpy() * np.float32(model.length))
    return rows, [*arrays, float_list("steps", np.concatenate(steps)), float_list("start", start)]


def _shapes(k: int, basis: StoredBasis) -> tuple[list[str], list[str]]:
    pointers, arrays = ["0", "0", "0"], []
    if len(basis.fine):
        bits = basis.fine.flatten(1).numpy().view(np.uint16)
        pointers[:2] = [f"high_{k}[0]", f"low_{k}[0]"]
        arrays += [byte_rows(f"high_{k}", (bits >> 8).astype(np.uint8)), byte_rows(f"low_{k}", bits.astype(np.uint8))]
    if len(basis.rough):
        pointers[2] = f"eight_{k}[0]"
        arrays.append(byte_rows(f"eight_{k}", basis.rough.flatten(1).numpy().view(np.uint8) + np.uint8(LETTER)))
    return pointers, arrays


def _rigid(mesh: Mesh, attachments: Attachments) -> tuple[list[list[str]], list[str]]:
    rows, arrays = [], []
    for k, (segment, carriers) in enumerate(zip(attachments.segment, attachments.vertex, strict=True)):
        members = np.flatnonzero(mesh.segment == segment)
        rest = mesh.neutral[carriers].astype(np.float64)
        centre = rest.mean(0)
        rows.append(
            [str(len(carriers)), str(len(members)), *(f"{n}_{k}" for n in ("carriers", "placed", "rest", "arms"))]
        )
        arrays += [
            index_list(f"carriers_{k}", carriers),
            index_list(f"placed_{k}", members),
            float_list(f"rest_{k}", rest - centre),
            float_list(f"arms_{k}", mesh.neutral[members] - centre),
        ]
    return rows, arrays


def _tables(regions: list[tuple], rigid: list[list[str]]) -> list[str]:
    return [
        f"static const moving_region regions[] = {{\n{structures(map(str, row) for row in regions)}}};\n",
        f"static const rigid_segment rigid[] = {{\n{structures(rigid or NOTHING)}}};",
    ]


# Numbers as C99 source that compiles in seconds: bytes as strings, short arrays as lists.

BYTES_A_LINE = 48
NUMBERS_A_LINE = 12
PLAIN = {code for code in range(32, 127) if chr(code) not in '"\\?'}  # "??" begins a trigraph
SHORT = [chr(code) if code in PLAIN else f"\\{code:o}" for code in range(256)]
LONG = [chr(code) if code in PLAIN else f"\\{code:03o}" for code in range(256)]  # before a digit
DIGITS = set(b"01234567")


def byte_rows(name: str, rows: UInt8[np.ndarray, "r k"]) -> str:
    """Return `static const byte name[r][k + 1]`: strings a row, and a zero at its end."""
    strings = ",\n".join(_strings(row.tobytes()) for row in rows)
    return f"static const byte {name}[{rows.shape[0]}][{rows.shape[1] + 1}] = {{\n{strings}}};\n"


def float_list(name: str, values: Float[np.ndarray, "*shape"]) -> str:
    """Return `static const float name[k]`, to the last bit."""
    return _list("float", name, list(map(float_number, np.asarray(values, np.float32).ravel().tolist())))


def index_list(name: str, values: Int[np.ndarray, " k"]) -> str:
    """Return `static const uint32_t name[k]`."""
    return _list("uint32_t", name, list(map(str, np.asarray(values).tolist())))


def float_number(value: float) -> str:
    """Return a float32 as C source, exact to the last bit."""
    text = f"{value:.9g}"
    return f"{text}f" if set(text) & set(".e") else f"{text}.0f"


def quoted(text: str) -> str:
    """Return a text as a string of C in ASCII."""
    return _string(text.encode())


def in_comment(text: str) -> str:
    """Return a text that can't end the C comment around it."""
    return text.replace("*/", "* /").replace("/*", "/ *")


def structures(rows: Iterable[Sequence[str]]) -> str:
    """Return the rows of an array of structures."""
    return ",\n".join(f"    {{{', '.join(row)}}}" for row in rows)


def _list(kind: str, name: str, words: list[str]) -> str:
    lines = ",\n".join(", ".join(words[i : i + NUMBERS_A_LINE]) for i in range(0, len(words), NUMBERS_A_LINE))
    return f"static const {kind} {name}[{len(words)}] = {{\n{lines}}};\n"


def _strings(data: bytes) -> str:
    """Return bytes as strings that C joins, one a line."""
    return "\n".join(_string(data[i : i + BYTES_A_LINE]) for i in range(0, len(data), BYTES_A_LINE))


def _string(data: bytes) -> str:
    following = data[1:] + b" "
    return (
        f'"{"".join((LONG if after in DIGITS else SHORT)[code] for code, after in zip(data, following, strict=True))}"'
    )
