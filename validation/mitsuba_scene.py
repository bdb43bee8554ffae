"""Loads one of our binary glTF scenes into Mitsuba 3, material by material.

Written against the glTF 2.0 specification and not against our importer, so that a mistake in the importer shows up as a
difference between the two renderers. Covers what `cargo xtask scenes` writes: triangle lists with normals, a node
hierarchy with instances, opaque metallic-roughness materials, clear dielectric solids, stochastic coverage, one-sided
emitters, one perspective camera. Anything else is an error.

Mapping
    opaque                    `principled` (specular 0.5, that is eta 1.5) inside `twosided`
    transmission + volume     `dielectric` with the material's index (no absorption: `path` knows no media)
    alphaMode BLEND           `mask` of the above with opacity = base colour alpha
    emissive                  any of the above with a one-sided `area` light, radiance = nit / 683 in each channel; a black
                              light still reflects its specular 4 %
"""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterator

import numpy as np

# Our scenes are in metres. Mitsuba moves ray origins by about 1e-4 scene units, which in metres would swallow the
# 40 um between ink and film; in millimetres it is 0.1 um there. Radiance does not depend on the unit.
UNITS_PER_METRE = 1000.0

LUMENS_PER_WATT = 683.0

_COMPONENTS = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC3": 3}


@dataclass
class Placed:
    """One mesh primitive where the scene shows it, in world coordinates and metres."""

    name: str
    positions: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    material: dict[str, Any]


@dataclass
class Camera:
    """A perspective camera: camera-to-world matrix (view along -z, y up) and full vertical angle in radians."""

    to_world: np.ndarray
    yfov: float


class Glb:
    """A binary glTF file: its JSON and the numbers behind its accessors."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data, 0)
        if magic != b"glTF" or version != 2 or length != len(data):
            raise ValueError(f"{path}: not a binary glTF 2.0 file")
        size, kind = struct.unpack_from("<I4s", data, 12)
        if kind != b"JSON":
            raise ValueError(f"{path}: the first chunk is not JSON")
        self.json: dict[str, Any] = json.loads(data[20 : 20 + size])
        self.binary = data[28 + size :]

    def accessor(self, index: int) -> np.ndarray:
        """The values of an accessor, one row per element."""
        accessor = self.json["accessors"][index]
        view = self.json["bufferViews"][accessor["bufferView"]]
        if "byteStride" in view or "sparse" in accessor or accessor.get("normalized"):
            raise NotImplementedError("strided, sparse or normalised accessors")
        width = _WIDTH[accessor["type"]]
        offset = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        kind = np.dtype(_COMPONENTS[accessor["componentType"]])
        values = np.frombuffer(self.binary, kind, accessor["count"] * width, offset)
        return values.reshape(-1, width)

    def nodes(self) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
        """Every node of the default scene with its 4 x 4 matrix to the world."""
        scene = self.json["scenes"][self.json.get("scene", 0)]
        stack = [(index, np.eye(4)) for index in reversed(scene["nodes"])]
        while stack:
            index, parent = stack.pop()
            node = self.json["nodes"][index]
            matrix = parent @ _local_matrix(node)
            yield node, matrix
            stack.extend((child, matrix) for child in reversed(node.get("children", [])))

    def placed(self) -> Iterator[Placed]:
        """Every primitive of every node, transformed."""
        for node, matrix in self.nodes():
            if "mesh" not in node:
                continue
            for primitive in self.json["meshes"][node["mesh"]]["primitives"]:
                attributes = primitive["attributes"]
                if primitive.get("mode", 4) != 4 or set(attributes) != {"POSITION", "NORMAL"}:
                    raise NotImplementedError(f"{node['name']}: only triangle lists with normals")
                linear = matrix[:3, :3]
                positions = self.accessor(attributes["POSITION"]) @ linear.T + matrix[:3, 3]
                normals = self.accessor(attributes["NORMAL"]) @ np.linalg.inv(linear)
                normals /= np.linalg.norm(normals, axis=1, keepdims=True)
                triangles = self.accessor(primitive["indices"]).reshape(-1, 3).astype(np.uint32)
                if np.linalg.det(linear) < 0.0:
                    triangles = triangles[:, ::-1]
                material = self.json["materials"][primitive["material"]]
                yield Placed(node["name"], positions, normals, triangles, material)

    def camera(self, name: str = "camera") -> Camera:
        """The camera of that name."""
        for node, matrix in self.nodes():
            if "camera" in node:
                camera = self.json["cameras"][node["camera"]]
                if camera["name"] == name or node["name"] == name:
                    return Camera(matrix, camera["perspective"]["yfov"])
        raise KeyError(f"no camera named {name}")


# Gives the triangles (triangle, corner, xyz) that replace those of a primitive, or nothing.
Cut = Callable[[Glb, dict[str, Any]], np.ndarray | None]


def equal_terms(path: Path, zoom: float, target: Path, faceted: bool = False, cut: Cut | None = None) -> Path:
    """Writes a copy of a scene for both renderers: without absorption, which `path` does not support, and with cameras that
    see a part smaller by `zoom` about the middle of the image. If `faceted`, no normal is interpolated, because that is
    where the renderers differ; `cut` may give the triangles of a primitive then."""
    glb = Glb(path)
    scene, binary = glb.json, bytearray(glb.binary)
    if faceted:
        for mesh in scene["meshes"]:
            for primitive in mesh["primitives"]:
                _make_flat(glb, primitive, binary, cut(glb, primitive) if cut else None)
        scene["buffers"][0]["byteLength"] = len(binary)
    for camera in scene["cameras"]:
        view = camera["perspective"]
        view["yfov"] = 2.0 * math.atan(math.tan(0.5 * view["yfov"]) / zoom)
    for material in scene["materials"]:
        volume = material.get("extensions", {}).get("KHR_materials_volume", {})
        volume.pop("attenuationColor", None)
        volume.pop("attenuationDistance", None)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    length = 12 + 8 + len(text) + 8 + len(binary)
    header = struct.pack("<4sIII4s", b"glTF", 2, length, len(text), b"JSON")
    target.write_bytes(header + text + struct.pack("<I4s", len(binary), b"BIN\0") + bytes(binary))
    return target


def job(scene: Path) -> Path:
    """Writes a job of ours beside a scene: the sum of lobes of Mitsuba's `principled` instead of layers."""
    path = scene.with_suffix(".toml")
    path.write_text(f'scene = "{scene.name}"\n\n[render]\nprincipled = "mitsuba"\n')
    return path


def _make_flat(glb: Glb, primitive: dict[str, Any], binary: bytearray, triangles: np.ndarray | None) -> None:
    """Gives every triangle of a primitive, or those that shall replace them, vertices of its own, with its own normal."""
    if triangles is None:
        indices = glb.accessor(primitive["indices"]).reshape(-1)
        triangles = glb.accessor(primitive["attributes"]["POSITION"])[indices].reshape(-1, 3, 3).astype(float)
    corners = triangles.reshape(-1, 3).astype(np.float32)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def accessor(values: np.ndarray, kind: str, code: int, **more: Any) -> int:
        binary.extend(b"\0" * (-len(binary) % 4))
        data = np.ascontiguousarray(values, dtype=_COMPONENTS[code]).tobytes()
        glb.json["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        binary.extend(data)
        view = len(glb.json["bufferViews"]) - 1
        glb.json["accessors"].append(
            {"bufferView": view, "componentType": code, "count": len(values), "type": kind, **more}
        )
        return len(glb.json["accessors"]) - 1

    bounds = {"min": corners.min(axis=0).tolist(), "max": corners.max(axis=0).tolist()}
    position = accessor(corners, "VEC3", 5126, **bounds)
    primitive["attributes"] = {"POSITION": position, "NORMAL": accessor(np.repeat(normals, 3, axis=0), "VEC3", 5126)}
    primitive["indices"] = accessor(np.arange(len(corners)), "SCALAR", 5125)


def _local_matrix(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"]).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0.0, 0.0, 0.0, 1.0])
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def bsdf(material: dict[str, Any]) -> dict[str, Any]:
    """Mitsuba's description of a glTF material."""
    extensions = material.get("extensions", {})
    known = {
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_transmission",
        "KHR_materials_volume",
    }
    if unknown := set(extensions) - known:
        raise NotImplementedError(f"{material['name']}: {sorted(unknown)}")
    pbr = material["pbrMetallicRoughness"]
    if extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0) == 1.0:
        if pbr["roughnessFactor"] != 0.0:
            raise NotImplementedError(f"{material['name']}: rough transmission")
        ior = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
        return {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
    *colour, alpha = pbr["baseColorFactor"]
    surface: dict[str, Any] = {
        "type": "twosided",
        "bsdf": {
            "type": "principled",
            "base_color": {"type": "rgb", "value": colour},
            "roughness": pbr["roughnessFactor"],
            "metallic": pbr["metallicFactor"],
            "specular": 0.5,
        },
    }
    if material.get("alphaMode", "OPAQUE") == "BLEND":
        return {"type": "mask", "opacity": alpha, "nested": surface}
    return surface


def radiance(material: dict[str, Any]) -> list[float]:
    """Emitted radiance in W/(m^2 sr) per channel."""
    strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {})
    factor = strength.get("emissiveStrength", 1.0) / LUMENS_PER_WATT
    return [factor * channel for channel in material.get("emissiveFactor", [0.0, 0.0, 0.0])]


def load(
    path: Path,
    width: int = 512,
    height: int = 512,
    camera: str = "camera",
    without: frozenset[str] = frozenset(),
    rr_depth: int = 16,
    sampler: str = "independent",
) -> Any:
    """Builds the Mitsuba scene; set the variant first. Nodes named in `without` are left out. Roulette from depth `rr_depth`
    on does not change the mean."""
    import mitsuba as mi

    glb = Glb(path)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": -1, "rr_depth": rr_depth},
        "sensor": _sensor(glb.camera(camera), width, height) | {"sampler": {"type": sampler, "sample_count": 1}},
    }
    materials: dict[str, Any] = {}
    for number, placed in enumerate(glb.placed()):
        if placed.name in without:
            continue
        name = placed.material["name"]
        if name not in materials:
            materials[name] = mi.load_dict(bsdf(placed.material))
        scene[f"shape-{number:04}"] = _shape(placed, materials[name])
    return mi.load_dict(scene)


def _sensor(camera: Camera, width: int, height: int) -> dict[str, Any]:
    import mitsuba as mi

    # Mitsuba looks along +z with +x to the left: turn glTF's frame by half a turn about y.
    to_world = camera.to_world @ np.diag([-1.0, 1.0, -1.0, 1.0])
    to_world[:3, 3] *= UNITS_PER_METRE
    return {
        "type": "perspective",
        "fov": math.degrees(camera.yfov),
        "fov_axis": "y",
        "near_clip": 0.1,
        "far_clip": 1e5,
        "to_world": mi.ScalarTransform4f(to_world),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
    }


def _shape(placed: Placed, material: Any) -> Any:
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = material
    emitted = radiance(placed.material)
    if max(emitted) > 0.0:
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": emitted}})
    mesh = mi.Mesh(
        placed.name,
        vertex_count=len(placed.positions),
        face_count=len(placed.triangles),
        has_vertex_normals=True,
        props=properties,
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = (placed.positions * UNITS_PER_METRE).astype(np.float32).ravel()
    parameters["vertex_normals"] = placed.normals.astype(np.float32).ravel()
    parameters["faces"] = placed.triangles.ravel()
    parameters.update()
    return mesh
