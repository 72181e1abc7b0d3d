"""A pose as the posing page saves it: JSON with every control's value, and where the control points are wanted."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.base.schema import shown
from replicate.base.user_files import read_text, shown_path

FORMAT, VERSION = "facial pose", 1
SLACK = 1e-4  # beyond a limit, as rounding in the page leaves it
MOST_BYTES = 1_000_000
FARTHEST_MM = 1e4  # of a control point, in each direction


def write_pose(
    file: Path,
    rig: Rig,
    params: Float[np.ndarray, " m"],
    names: Sequence[str],
    targets: Float[np.ndarray, "c 3"],
) -> None:
    """Write a pose as the page does.

    file: the JSON file
    rig: for its name and its controls' names
    params: raw rig parameters
    names: of the control points
    targets: where the control points are wanted, mm
    """
    controls = {c.name: round(float(value), 6) for c, value in zip(rig.controls, params, strict=True)}
    points = {name: [round(float(x), 4) for x in place] for name, place in zip(names, targets, strict=True)}
    words = {"format": FORMAT, "version": VERSION, "character": rig.name, "controls": controls, "points": points}
    write_text(file, json.dumps(words, indent=1) + "\n")


def read_pose(
    file: Path, rig: Rig, names: Sequence[str] = ()
) -> tuple[Float32[np.ndarray, " m"], Float32[np.ndarray, "c 3"] | None]:
    """Return (params, targets) of a saved pose; targets is None where the file has no control points.

    names: of the control points that are read. Raises InputError, naming the file, for a file that isn't JSON, another
    character's pose, a missing or unknown control, and a value beyond its limits.
    """
    where = shown_path(file)
    words = _table(file, where)
    if words["version"] != VERSION:
        raise InputError(f"{where}: expected a pose of version {VERSION}, got {shown(words['version'])}")
    if words.get("character") != rig.name:
        raise InputError(f"{where}: this pose is of the character {shown(words.get('character'))}, not of {rig.name}")
    params = _params(words["controls"], rig, where)
    if "points" not in words:
        return params, None
    points = words["points"] if isinstance(words["points"], Mapping) else {}
    for name in names:
        place = points.get(name)
        if not (isinstance(place, list) and len(place) == 3 and all(map(_is_length, place))):
            raise InputError(
                f"{where}: control point {name!r}: expected three lengths from {-FARTHEST_MM:g} to {FARTHEST_MM:g} mm, "
                f"got {shown(place)}"
            )
    return params, np.array([points[name] for name in names], np.float32).reshape(-1, 3)


def _table(file: Path, where: str) -> dict:
    text = read_text(file, MOST_BYTES)
    try:
        words = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: this file is not JSON ({str(error) or 'nested too deeply'})") from None
    if not (isinstance(words, dict) and words.get("format") == FORMAT and isinstance(words.get("controls"), dict)):
        raise InputError(
            f'{where}: this file is not a saved pose: expected a table with "format": "{FORMAT}" and "controls"'
        )
    return {"version": None, **words}


def _params(values: Mapping[str, object], rig: Rig, where: str) -> Float32[np.ndarray, " m"]:
    known = {control.name for control in rig.controls}
    unknown = next((name for name in values if name not in known), None)
    if unknown is not None:
        raise InputError(f"{where}: {rig.name} has no control {shown(unknown)}")
    params = np.array(rig.default, np.float32)
    for j, control in enumerate(rig.controls):
        if control.name not in values:
            raise InputError(f"{where}: control {control.name!r}: expected a value, got none")
        value, lower, upper = values[control.name], float(rig.lower[j]), float(rig.upper[j])
        if not (_is_number(value) and lower - SLACK <= value <= upper + SLACK):
            raise InputError(
                f"{where}: control {control.name!r}: expected a number from {lower:g} to {upper:g}, got {shown(value)}"
            )
        params[j] = min(max(value, lower), upper)
    return params


def _is_length(value: object) -> bool:
    return _is_number(value) and abs(value) <= FARTHEST_MM


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < math.inf
