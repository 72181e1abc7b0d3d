"""Meshes as USD: still, with blend shapes whose weights an animation drives (UsdSkel), or with points frame by frame.

Everything is below one prim, in metres with y up. A mesh keeps its vertices' order. Its segments are subsets of its
faces, and where the controls' values are known, they are attributes of that prim: `controls:names`, `:regions`,
`:lower`, `:default`, `:upper`, and `controls:values`, a row a frame.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Int

from data_recipes.rig import Control
from replicate.base.exceptions import InputError
from replicate.export.animation import FRAMES_PER_SECOND, Track
from replicate.export.files import MM_PER_M, ROUGHNESS, WET_ROUGHNESS, Part, linear, unit_normals
from replicate.geometry.mesh import Mesh

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom, UsdShade

ENDINGS = (".usd", ".usda", ".usdc")
SKELETON, ANIMATION, MATERIALS, JOINT = "Skeleton", "Animation", "Materials", "root"
PROP = "shownOnly"  # custom data of meshes that a rig shows and that are not its own
CHUNK_FRAMES = 64


@dataclass(frozen=True)
class BlendShape:
    """What a weight of 1 adds to a mesh.

    name: different from those of the mesh's other shapes.
    offsets: (k, 3) mm.
    vertices: (k,), ascending, where only some move; None for all of them.
    normals: (k, 3), what it adds to the normals, or None.
    """

    name: str
    offsets: Float[np.ndarray, "k 3"]
    vertices: Int[np.ndarray, " k"] | None = None
    normals: Float[np.ndarray, "k 3"] | None = None


@dataclass(frozen=True)
class UsdPart:
    """A part and how it moves: by shapes, by points frame by frame, or not at all.

    part: at rest.
    mesh: of the same vertices and faces, whose segments are written, or None.
    shapes, weights: weights (t, k) of each shape and frame; None for shapes that nothing drives.
    frames: (t, n, 3) mm, points in place of shapes, or None.
    is_prop: whether it is for display only.
    """

    part: Part
    mesh: Mesh | None = None
    shapes: tuple[BlendShape, ...] = ()
    weights: Float[np.ndarray, "t k"] | None = None
    frames: Float[np.ndarray, "t n 3"] | None = None
    is_prop: bool = False

    @property
    def length(self) -> int:
        """The number of its frames, 0 if it has none."""
        moved = self.weights if self.frames is None else self.frames
        return 0 if moved is None else len(moved)


@dataclass(frozen=True)
class ControlTrack:
    """A rig's controls and their values (t, m): one row for a pose, a row a frame for a clip."""

    controls: Sequence[Control]
    values: Float[np.ndarray, "t m"]


def has_usd() -> bool:
    """Return whether the package usd-core is installed."""
    return find_spec("pxr") is not None


def check_usd() -> None:
    """Raise InputError where the package usd-core is missing."""
    if not has_usd():
        sentence = "USD files need the package usd-core, of the extra `usd`: python -m pip install usd-core"
        raise InputError(sentence)


def shaped_usd(
    head: Part,
    mesh: Mesh | None,
    shapes: Sequence[BlendShape],
    about: dict,
    ending: str = ".usdc",
    weights: Float[np.ndarray, "t k"] | None = None,
    frames_per_second: float = FRAMES_PER_SECOND,
) -> bytes:
    """Return a USD of one neutral mesh and its blend shapes.

    head: the mesh at rest, with its UVs
    mesh: whose segments are written, or None
    shapes: none of them has shapes in between
    about: words for the file's custom data
    ending: .usdc, .usda or .usd
    weights: of the shapes in each frame; without them all are 0
    frames_per_second: of the weights

    Raises InputError where usd-core is missing.
    """
    return usd([UsdPart(head, mesh, tuple(shapes), weights)], about, ending, frames_per_second)


def track_shapes(track: Track) -> tuple[BlendShape, ...]:
    """Return the shapes of a clip's track, named as a GLB names its morph targets."""
    pairs = enumerate(zip(track.shapes, track.normals, strict=True))
    return tuple(BlendShape(f"shape_{k:03d}", offsets, None, normals) for k, (offsets, normals) in pairs)


def usd(
    parts: Sequence[UsdPart],
    about: dict,
    ending: str,
    frames_per_second: float = FRAMES_PER_SECOND,
    controls: ControlTrack | None = None,
) -> bytes:
    """Return a USD of some parts.

    parts: the first gives its name to the prim that all are below
    about: words for the file's custom data
    ending: .usdc, .usda or .usd; the first and the last are binary
    frames_per_second: of weights and frames
    controls: whose values are written too

    Raises InputError where usd-core is missing.
    """
    check_usd()
    from pxr import Sdf, Usd, UsdGeom, UsdSkel

    stage = Usd.Stage.CreateInMemory(ending)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    is_shaped = any(item.shapes for item in parts)
    top = stage.GetPseudoRoot().GetPath().AppendChild(_identifier(parts[0].part.name, ()))
    root = (UsdSkel.Root if is_shaped else UsdGeom.Xform).Define(stage, top).GetPrim()
    stage.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind("component")
    root.SetCustomData({key: str(value) for key, value in about.items()})
    length = max(item.length for item in parts)
    if length:
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(length - 1)
        stage.SetTimeCodesPerSecond(frames_per_second)
        stage.SetFramesPerSecond(frames_per_second)
    taken, paths = {SKELETON, ANIMATION, MATERIALS}, []
    for item in parts:
        name = _identifier(item.part.name, taken)
        taken.add(name)
        paths.append(top.AppendChild(name))
        _write_mesh(stage, paths[-1], item, _material(stage, top, item.part.name.startswith("eye")))
    if is_shaped:
        _write_shapes(stage, top, list(zip(paths, parts, strict=True)), length)
        extents = np.array([_extents(item, length) for item in parts])  # (p, t, 2, 3)
        extents = np.stack([extents[:, :, 0].min(0), extents[:, :, 1].max(0)], axis=1)
        _set_frames(UsdGeom.Boundable(root).CreateExtentAttr(), extents if length else extents[:1], _vectors)
    if controls is not None:
        _write_controls(root, controls)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"stage{ending}"
        layer: Sdf.Layer = stage.GetRootLayer()
        layer.Export(str(file))
        return file.read_bytes()


def _identifier(name: str, taken: Collection[str]) -> str:
    """Return a name that a prim can have and none has taken."""
    from pxr import Tf

    plain, number = Tf.MakeValidIdentifier(name), 1
    found = plain
    while found in taken:
        number += 1
        found = f"{plain}_{number}"
    return found


def _vectors(rows: Float[np.ndarray, "k 3"]) -> Any:
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows, np.float32))


def _metres(rows: Float[np.ndarray, "*b n 3"]) -> Float32[np.ndarray, "*b n 3"]:
    return (np.asarray(rows, np.float64) / MM_PER_M).astype(np.float32)


def _set_frames(attribute: Usd.Attribute, rows: np.ndarray, convert: Callable[[np.ndarray], Any]) -> None:
    """Set an attribute to one value, or to one a frame where there are several."""
    if len(rows) == 1:
        attribute.Set(convert(rows[0]))
        return
    for k, row in enumerate(rows):
        attribute.Set(convert(row), k)


def _write_mesh(stage: Usd.Stage, path: Any, item: UsdPart, material: UsdShade.Material) -> None:
    """Write a part at rest, with its points in every frame if it has any."""
    from pxr import Sdf, UsdGeom, UsdShade, Vt

    part = item.part
    mesh = UsdGeom.Mesh.Define(stage, path)
    prim = mesh.GetPrim()
    prim.SetDisplayName(part.name)
    if item.is_prop:
        prim.SetCustomDataByKey(PROP, True)
    corners = Vt.IntArray.FromNumpy(np.ascontiguousarray(part.faces.reshape(-1), np.int32))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(part.faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(corners)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)  # the rig's own triangles, not a cage of theirs
    mesh.CreateDoubleSidedAttr(True)
    rest = _metres(part.vertices)
    points, normals = mesh.CreatePointsAttr(_vectors(rest)), mesh.CreateNormalsAttr(_vectors(part.normals))
    extent = mesh.CreateExtentAttr(_vectors(np.stack([rest.min(0), rest.max(0)])))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    for k, frame in enumerate(() if item.frames is None else item.frames):
        there = _metres(frame)
        points.Set(_vectors(there), k)
        normals.Set(_vectors(unit_normals(frame, part.faces)), k)
        extent.Set(_vectors(np.stack([there.min(0), there.max(0)])), k)
    primvars = UsdGeom.PrimvarsAPI(prim)
    types = Sdf.ValueTypeNames
    colour = primvars.CreatePrimvar("displayColor", types.Color3fArray, UsdGeom.Tokens.vertex)
    colour.Set(_vectors(linear(part.colours) / 255.0))
    if part.uv is not None:
        st = primvars.CreatePrimvar("st", types.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(part.uv, np.float32)))
        st.SetIndices(corners)
    if item.mesh is not None:
        _write_segments(mesh, item.mesh)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _write_segments(mesh: UsdGeom.Mesh, ours: Mesh) -> None:
    """Write segments as subsets of faces, and which of them each vertex is in."""
    from pxr import Sdf, UsdGeom, Vt

    taken, family = set(), "segment"
    for k, name in enumerate(ours.segment_names):
        plain = _identifier(name, taken)
        taken.add(plain)
        faces = Vt.IntArray.FromNumpy(np.flatnonzero(ours.face_segment == k).astype(np.int32))
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, plain, UsdGeom.Tokens.face, faces, family)
        subset.GetPrim().SetDisplayName(name)
    UsdGeom.Subset.SetFamilyType(mesh, family, UsdGeom.Tokens.partition)
    of_vertex = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("segment", Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.vertex)
    of_vertex.Set(Vt.IntArray.FromNumpy(ours.segment))


def _material(stage: Usd.Stage, top: Any, wet: bool) -> UsdShade.Material:
    """Return the material of matt parts or of wet ones, whose colour is that of the vertices."""
    from pxr import Sdf, UsdGeom, UsdShade

    UsdGeom.Scope.Define(stage, top.AppendChild(MATERIALS))
    path = top.AppendChild(MATERIALS).AppendChild("wet" if wet else "matt")
    material, types = UsdShade.Material.Define(stage, path), Sdf.ValueTypeNames
    colour = UsdShade.Shader.Define(stage, path.AppendChild("Colour"))
    colour.CreateIdAttr("UsdPrimvarReader_float3")
    colour.CreateInput("varname", types.String).Set("displayColor")
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", types.Float).Set(WET_ROUGHNESS if wet else ROUGHNESS)
    diffuse = surface.CreateInput("diffuseColor", types.Color3f)
    diffuse.ConnectToSource(colour.CreateOutput("result", types.Float3))
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    return material


def _write_shapes(stage: Usd.Stage, top: Any, parts: Sequence[tuple[Any, UsdPart]], length: int) -> None:
    """Write the shapes of all parts and one animation of their weights.

    Programs find an animation by a skeleton. This one has a joint that never moves, and all parts hang on it.
    """
    from pxr import Gf, Sdf, UsdSkel, Vt

    skeleton = UsdSkel.Skeleton.Define(stage, top.AppendChild(SKELETON))
    skeleton.CreateJointsAttr([JOINT])
    rest = Vt.Matrix4dArray([Gf.Matrix4d(1.0)])
    skeleton.CreateBindTransformsAttr(rest)
    skeleton.CreateRestTransformsAttr(rest)
    animation = UsdSkel.Animation.Define(stage, top.AppendChild(ANIMATION))
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    several = sum(bool(item.shapes) for _, item in parts) > 1
    names, weights = [], []
    for path, item in parts:
        prim = stage.GetPrimAtPath(path)
        binding = UsdSkel.BindingAPI.Apply(prim)
        binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
        binding.CreateJointIndicesPrimvar(True, 1).Set(Vt.IntArray([0]))
        binding.CreateJointWeightsPrimvar(True, 1).Set(Vt.FloatArray([1.0]))
        binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
        if not item.shapes:
            continue
        taken, targets = {child.GetName() for child in prim.GetChildren()}, []
        for shape in item.shapes:
            name = _identifier(shape.name, taken)
            taken.add(name)
            targets.append(path.AppendChild(name))
            written = UsdSkel.BlendShape.Define(stage, targets[-1])
            written.CreateOffsetsAttr(_vectors(_metres(shape.offsets)))
            written.GetPrim().SetDisplayName(shape.name)
            if shape.normals is not None:
                written.CreateNormalOffsetsAttr(_vectors(shape.normals))
            if shape.vertices is not None:
                written.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(np.asarray(shape.vertices, np.int32)))
        driven = [f"{path.name}:{shape.name}" if several else shape.name for shape in item.shapes]
        binding.CreateBlendShapesAttr(driven)
        binding.CreateBlendShapeTargetsRel().SetTargets(targets)
        names += driven
        frames = max(length, 1)
        weights.append(np.zeros((frames, len(driven))) if item.weights is None else item.weights)
    animation.CreateBlendShapesAttr(names)
    attribute = animation.GetPrim().CreateAttribute("blendShapeWeights", Sdf.ValueTypeNames.FloatArray, False)
    together = np.concatenate(weights, axis=1).astype(np.float32)
    _set_frames(attribute, together, lambda row: Vt.FloatArray.FromNumpy(np.ascontiguousarray(row)))


def _extents(item: UsdPart, length: int) -> Float[np.ndarray, "t 2 3"]:
    """Return the corners of the box around a part in each frame; without weights, one that holds each shape alone."""
    rest, frames = item.part.vertices, max(length, 1)
    if item.frames is not None:
        moved = (frame[None] for frame in item.frames)
    elif item.weights is not None and item.shapes:
        moved = (_shaped(item, item.weights[k : k + CHUNK_FRAMES]) for k in range(0, length, CHUNK_FRAMES))
    else:
        moved = (rest[_where(shape)] + shape.offsets for shape in item.shapes if len(shape.offsets))
        ends = np.array([rest.min(0), rest.max(0), *(end for part in moved for end in (part.min(0), part.max(0)))])
        return np.repeat(_metres(np.stack([ends.min(0), ends.max(0)]))[None], frames, axis=0)
    return np.concatenate([np.stack([_metres(part).min(1), _metres(part).max(1)], axis=1) for part in moved])


def _shaped(item: UsdPart, weights: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t n 3"]:
    rest = item.part.vertices.astype(np.float64)
    if all(shape.vertices is None for shape in item.shapes):
        shapes = np.array([shape.offsets.reshape(-1) for shape in item.shapes], np.float64)
        return rest + (weights @ shapes).reshape(-1, *rest.shape)
    out = np.repeat(rest[None], len(weights), axis=0)
    for column, shape in zip(weights.T, item.shapes, strict=True):
        out[:, _where(shape)] += column[:, None, None] * shape.offsets
    return out


def _where(shape: BlendShape) -> np.ndarray | slice:
    return slice(None) if shape.vertices is None else shape.vertices


def _write_controls(root: Usd.Prim, controls: ControlTrack) -> None:
    """Write what the controls are and their values, as attributes of the file's prim."""
    from pxr import Sdf, Vt

    types, ours = Sdf.ValueTypeNames, controls.controls
    for key in ("name", "region"):
        words = [getattr(control, key) for control in ours]
        root.CreateAttribute(f"controls:{key}s", types.StringArray, True, Sdf.VariabilityUniform).Set(words)
    for key in ("lower", "default", "upper"):
        numbers = Vt.DoubleArray([float(getattr(control, key)) for control in ours])
        root.CreateAttribute(f"controls:{key}", types.DoubleArray, True, Sdf.VariabilityUniform).Set(numbers)
    values = root.CreateAttribute("controls:values", types.FloatArray, True)
    rows = np.ascontiguousarray(controls.values, np.float32)
    _set_frames(values, rows, Vt.FloatArray.FromNumpy)
