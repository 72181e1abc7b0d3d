"""What can be wrong with a folder of samples, by the hundred: functions that spoil a good one."""

import os
import shutil
from pathlib import Path

import numpy as np
from folder_faults import (
    Fault,
    change_arrays,
    change_text,
    cut,
    put_at,
    put_instead,
    set_array,
    two_shards,
    write_bytes,
)
from sample_folders import CONTROLS, FACE, neutral, obj, shard

HUGE = "9" * 400
HEADER_OF_BRACKETS = b"\x93NUMPY\x01\x00" + (9_000).to_bytes(2, "little") + b"[" * 9_000
SPECIAL = {
    "a folder": lambda file: file.mkdir(),
    "a pipe": lambda file: os.mkfifo(file),
    "a device": lambda file: file.symlink_to("/dev/zero"),
    "a loop": lambda file: file.symlink_to(file),
    "missing": lambda file: None,
    "a link to nothing": lambda file: file.symlink_to("nowhere"),
}


def _special() -> dict[str, Fault]:
    names = ("face.toml", "controls.csv", "mesh.obj", "poses/001.npz")
    pairs = [(name, what) for name in names for what in SPECIAL]
    pairs.remove(("poses/001.npz", "missing"))  # a shard less is no fault
    return {f"{name} is {what}": put_instead(name, SPECIAL[what]) for name, what in pairs}


def _toml() -> dict[str, Fault]:
    values = {
        "name": ('""', '"a b"', "3", '"' + "n" * 300 + '"'),
        "unit": ('"km"', "10", "nan"),
        "up": ('"x"', "2"),
        "mesh": ('"mesh.fbx"', '"../mesh.obj"', '"/etc/mesh.obj"', "[]", '"other.obj"', '"mesh\\u0000.obj"'),
        "segments": ('"parts"', "true"),
    }
    faults = {
        f"{key} = {value[:20]}": change_text(
            "face.toml", next(x for x in FACE.splitlines() if x.startswith(key)), f"{key} = {value}"
        )
        for key, options in values.items()
        for value in options
    }
    for line in FACE.splitlines()[:-1]:  # segments have a default
        faults[f"without {line}"] = change_text("face.toml", line, "")
    more = {
        "an unknown key": "units = 3",
        "no frames a second": "frames_per_second = 0",
        "frames a second as text": 'frames_per_second = "24"',
        "eyes of two numbers": "eyes = [0, 1]",
        "eyes that are NaN": "eyes = [0, 1, nan]",
        "two lines of licence": 'licence = "a\\nb"',
        "a long source": f'source = "{"s" * 600}"',
        "a landmark that is no vertex": "[points]\nlandmarks = [1, 2, 30]",
        "a landmark below zero": "[points]\nlandmarks = [1, 2, -1]",
        "two landmarks": "[points]\nlandmarks = [1, 2]",
        "a landmark twice": "[points]\nlandmarks = [1, 2, 2]",
        "the first vertex as a landmark twice": "[points]\nlandmarks = [0, 1, 2, 0]",
        "landmarks in fractions": "[points]\nlandmarks = [1, 2, 2.5]",
        "control points that are a list": "[points]\ncontrol_points = [1, 2]",
        "control points without vertices": "[points.control_points]\nmouth = []",
        "a control point that is no vertex": "[points.control_points]\nmouth = [30]",
        "a control point of two regions": "[points.control_points]\nmouth = [3]\nbrows = [3]",
        "the first vertex as a control point of two regions": "[points.control_points]\nmouth = [0]\nbrows = [0]",
        "a control point by name": '[points.control_points]\nmouth = ["chin"]',
        "no TOML": "= =",
    }
    return faults | {what: change_text("face.toml", FACE, f"{FACE}{text}\n") for what, text in more.items()}


def _csv() -> dict[str, Fault]:
    line = "jaw,0,0,1,mouth"
    cases = {
        "another header": ("name,lower,default,upper,region", "name,min,default,max,region"),
        "no header": ("name,lower,default,upper,region\n", ""),
        "a control twice": ("smile,", "jaw,"),
        "an empty range": (line, "jaw,1,1,1,mouth"),
        "a range upside down": (line, "jaw,1,0,0,mouth"),
        "a default out of range": (line, "jaw,0,2,1,mouth"),
        "a text in a number": (line, "jaw,zero,0,1,mouth"),
        "a limit that is NaN": (line, "jaw,nan,0,1,mouth"),
        "a limit beyond all": (line, f"jaw,0,0,{HUGE},mouth"),
        "four columns": (line, "jaw,0,0,1"),
        "six columns": (line, "jaw,0,0,1,mouth,x"),
        "no name": (line, ",0,0,1,mouth"),
        "a control too few": (line + "\n", ""),
        "a control too many": (line, line + "\nnod,0,0,1,head"),
        "a quote without end": (line, '"jaw,0,0,1,mouth'),
        "a name with a tab": (line, "ja\tw,0,0,1,mouth"),
    }
    faults = {f"controls: {what}": change_text("controls.csv", *pair) for what, pair in cases.items()}
    return faults | {
        "controls: empty": write_bytes("controls.csv", b""),
        "controls: no UTF-8": write_bytes("controls.csv", CONTROLS.encode("utf-16")),
        "controls: a header alone": write_bytes("controls.csv", CONTROLS.splitlines()[0].encode()),
    }


def _mesh() -> dict[str, Fault]:
    quad = "f 1/1 2/2 7/7 6/6"
    cases = {
        "a face out of range": (quad, "f 1/1 2/2 31/7 6/6"),
        "a face of vertex 0": (quad, "f 0/1 2/2 7/7 6/6"),
        "a face before all vertices": (quad, "f -31/1 2/2 7/7 6/6"),
        "a UV out of range": (quad, "f 1/1 2/2 7/31 6/6"),
        "a polygon of two corners": (quad, "f 1/1 2/2"),
        "a coordinate as text": ("v -90.0 -100.0", "v west -100.0"),
        "a coordinate that is NaN": ("v -90.0 -100.0", "v nan -100.0"),
        "a coordinate beyond all": ("v -90.0 -100.0", f"v {HUGE} -100.0"),
        "two coordinates": ("v -90.0 -100.0 24.0", "v -90.0 -100.0"),
        "a UV that is infinite": ("vt 0.0 0.0", "vt inf 0.0"),
        "a UV of one number": ("vt 0.0 0.0", "vt 0.0"),
        "a point that is no vertex": ("g lower", "g lower\np 99"),
        "a vertex number in words": (quad, "f one/1 2/2 7/7 6/6"),
    }
    faults = {f"mesh: {what}": change_text("mesh.obj", *pair) for what, pair in cases.items()}
    no_uv = obj(with_uv=False).encode()

    def islands(folder: Path) -> None:
        (folder / "mesh.obj").write_bytes(no_uv)
        change_text("face.toml", '"groups"', '"islands"')(folder)

    def glb(data: bytes) -> Fault:
        def fault(folder: Path) -> None:
            (folder / "mesh.glb").write_bytes(data)
            change_text("face.toml", "mesh.obj", "mesh.glb")(folder)

        return fault

    return faults | {
        "mesh: islands without UVs": islands,
        "mesh: empty": write_bytes("mesh.obj", b""),
        "mesh: vertices alone": write_bytes("mesh.obj", b"v 0 0 0\nv 1 0 0\n"),
        "mesh: binary": write_bytes("mesh.obj", b"\x89PNG\r\n\x1a\n\xff\xfe"),
        "mesh: a GLB that is none": glb(b"not a GLB"),
        "mesh: a GLB that is cut": glb(b"glTF\x02\0\0\0\xff\xff\0\0"),
        "mesh: an empty GLB": glb(b""),
    }


def _shards() -> dict[str, Fault]:
    big = np.zeros((4, 30, 3), np.float32)
    return {
        "NaN in vertices": set_array("vertices", lambda v: put_at(v, (3, 4, 1), np.nan)),
        "infinity in vertices": set_array("vertices", lambda v: put_at(v, (3, 4, 1), np.inf)),
        "NaN in params": set_array("params", lambda p: put_at(p, (3, 1), np.nan)),
        "infinity in params": set_array("params", lambda p: put_at(p, (3, 1), -np.inf)),
        "huge params": set_array("params", lambda p: put_at(p, (3, 1), 1e6)),
        "vertices of another mesh": set_array("vertices", lambda v: v[:, :-1]),
        "vertices in two dimensions": set_array("vertices", lambda v: v[..., :2]),
        "vertices as a table": set_array("vertices", lambda v: v.reshape(len(v), -1)),
        "a control too few in params": set_array("params", lambda p: p[:, :-1]),
        "a control too many in params": set_array("params", lambda p: np.concatenate([p, p[:, :1]], axis=1)),
        "a pose too few in params": set_array("params", lambda p: p[:-1]),
        "a pose too few in vertices": set_array("vertices", lambda v: v[:-1]),
        "params of one dimension": set_array("params", lambda p: p[:, 0]),
        "params of none": set_array("params", lambda p: p[0, 0]),
        "no poses": change_arrays(lambda a: a.update({name: array[:0] for name, array in a.items()})),
        "texts for params": set_array("params", lambda p: p.astype(str)),
        "complex vertices": set_array("vertices", lambda v: v.astype(complex)),
        "Python objects": set_array("clip", lambda c: c.astype(object)),
        "a clip's name of a thousand letters": set_array("clip", lambda c: np.array(["c" * 1000] * len(c))),
        "a clip's name beyond Unicode": set_array("clip", lambda c: np.full(len(c), 0x110000, np.uint32).view("<U1")),
        "half a pair of surrogates as a clip's name": set_array("clip", lambda c: np.array(["\ud800"] * len(c))),
        "a clip's name of two lines": set_array("clip", lambda c: np.array(["talk\nmore"] * len(c))),
        "a path as a clip's name": set_array("clip", lambda c: np.array(["../../x"] * len(c))),
        "a path of Windows as a clip's name": set_array("clip", lambda c: np.array(["x\\y"] * len(c))),
        "a header of brackets": _brackets,
        "frames in fractions": set_array("frame", lambda f: f + 0.5),
        "frames below zero": set_array("frame", lambda f: f - 100),
        "frames too few": set_array("frame", lambda f: f[:-1]),
        "drawn as numbers": set_array("drawn", lambda d: d.astype(int)),
        "a clip without frames": change_arrays(lambda a: a.pop("frame")),
        "drawn without clips": change_arrays(lambda a: (a.pop("frame"), a.pop("clip"))),
        "a frame twice": set_array("frame", lambda f: f - 20),
        "no params": change_arrays(lambda a: a.pop("params")),
        "no vertices": change_arrays(lambda a: a.pop("vertices")),
        "an empty npz": change_arrays(lambda a: a.clear()),
        "another unit by 10": set_array("vertices", lambda v: v * 10),
        "another unit by 1,000": set_array("vertices", lambda v: v / 1000),
        "offsets for positions": set_array("vertices", lambda v: v - neutral().astype(np.float32)),
        "another order of vertices": set_array("vertices", lambda v: v[:, ::-1]),
        "other axes": set_array("vertices", lambda v: v[..., [0, 2, 1]]),
        "a pose at rest that is not the mesh": change_arrays(
            lambda a: a.update(params=put_at(a["params"], (3,), 0.0), vertices=put_at(a["vertices"], (3, 4, 1), 0.0))
        ),
        "a mesh of another unit, by 10": change_text("face.toml", '"mm"', '"cm"'),
        "a mesh of another unit, by 1,000": change_text("face.toml", '"mm"', '"m"'),
        "a mesh of inches": change_text("face.toml", '"mm"', '"in"'),
        "a text beside the shards": write_bytes("poses/notes.txt", b"hello"),
        "a shard of nothing": write_bytes("poses/002.npz", b""),
        "a shard that is no zip": write_bytes("poses/002.npz", b"PK\x03\x04" + b"\0" * 99),
        "half a shard": cut("poses/001.npz", 0.5),
        "a shard less its last byte": cut("poses/001.npz", 0.999),
        "params alone in a pair": two_shards(params=np.zeros((4, 3), np.float32)),
        "vertices alone in a pair": two_shards(vertices=big),
        "a pair of two lengths": two_shards(params=np.zeros((3, 3), np.float32), vertices=big),
        "no folder of poses": lambda folder: shutil.rmtree(folder / "poses"),
        "no shards": lambda folder: [file.unlink() for file in (folder / "poses").iterdir()] and None,
        "an unfinished shard alone": _only_unfinished,
        "too few frames": _too_few,
        "a file in the place of poses": put_instead("poses", lambda file: file.write_text("")),
        "half an npy": _half_npy,
        "an npy that promises too much": _promise,
        "damage within a shard": _damage,
    }


def _influence() -> dict[str, Fault]:
    vertices, controls = len(neutral()), CONTROLS.count("\n") - 1

    def save(array: np.ndarray) -> Fault:
        return lambda folder: np.save(folder / "influence.npy", array)

    def promise(folder: Path) -> None:
        with open(folder / "influence.npy", "wb") as stream:
            header = {"descr": "|b1", "fortran_order": False, "shape": (10**15, controls)}
            np.lib.format.write_array_header_1_0(stream, header)

    cases = {
        "numbers": save(np.ones((vertices, controls))),
        "turned": save(np.ones((controls, vertices), bool)),
        "of another mesh": save(np.ones((vertices + 1, controls), bool)),
        "without a true": save(np.zeros((vertices, controls), bool)),
        "objects": save(np.full((vertices, controls), None)),
        "a promise": promise,
        "text": write_bytes("influence.npy", b"jaw moves the chin\n"),
        "empty": write_bytes("influence.npy", b""),
        "a header of brackets": write_bytes("influence.npy", HEADER_OF_BRACKETS),
        "half": lambda folder: (save(np.ones((vertices, controls), bool))(folder), cut("influence.npy", 0.6)(folder)),
        **{what: lambda folder, make=make: make(folder / "influence.npy")
           for what, make in SPECIAL.items() if what != "missing"},
    }  # fmt: skip
    return {f"influence: {what}": fault for what, fault in cases.items()}


def _only_unfinished(folder: Path) -> None:
    (folder / "poses" / "001.npz").unlink()
    (folder / "poses" / "000.npz").rename(folder / "poses" / "000.npz.part")


def _too_few(folder: Path) -> None:
    (folder / "poses" / "001.npz").unlink()
    np.savez(folder / "poses" / "000.npz", **shard(0, 8))


def _brackets(folder: Path) -> None:
    two_shards(params=np.zeros((4, 3), np.float32), vertices=np.zeros((4, 30, 3), np.float32))(folder)
    (folder / "poses" / "pair.params.npy").write_bytes(HEADER_OF_BRACKETS)


def _half_npy(folder: Path) -> None:
    two_shards(params=np.zeros((4, 3), np.float32), vertices=np.zeros((4, 30, 3), np.float32))(folder)
    cut("poses/pair.vertices.npy", 0.5)(folder)


def _promise(folder: Path) -> None:
    two_shards(params=np.zeros((4, 3), np.float32), vertices=np.zeros((4, 30, 3), np.float32))(folder)
    with open(folder / "poses" / "pair.vertices.npy", "wb") as stream:
        header = {"descr": "<f4", "fortran_order": False, "shape": (10**15, 30, 3)}
        np.lib.format.write_array_header_1_0(stream, header)


def _damage(folder: Path) -> None:
    file = folder / "poses" / "001.npz"
    data = bytearray(file.read_bytes())
    place = bytes(data).index(b"vertices.npy") + 500
    data[place] ^= 0xFF
    file.write_bytes(bytes(data))


def faults() -> dict[str, Fault]:
    """Return, by what is wrong, functions that spoil a good folder."""
    return _special() | _toml() | _csv() | _mesh() | _shards() | _influence()
