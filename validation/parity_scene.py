"""Scenes for both renderers, written once: shapes, materials, lights and a camera as plain data.

`write` makes them the input of ours, a binary glTF file with the shapes and a job (TOML) with everything that a case is
about; `parity_mitsuba.py` makes them Mitsuba's. Metres, +y up, linear Rec. 709, radiance in W/(m^2 sr).
"""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Triple = tuple[float, float, float]

LUMENS_PER_WATT = 683.0

# Of cameras with a lens, in metres: any will do that gives an f-number a job accepts.
FILM_HEIGHT = 0.1


@dataclass(frozen=True)
class Medium:
    """What fills a solid: coefficients in 1/m and the mean cosine of Henyey and Greenstein (1941)."""

    absorption: Triple
    scattering: Triple = (0.0, 0.0, 0.0)
    anisotropy: float = 0.0


@dataclass(frozen=True)
class Material:
    """Parameters named after Mitsuba's `principled`; `kind` is the BSDF."""

    # "principled", "dielectric" (closed solid), "thin" (clear sheet) or "black" (scatters nothing).
    kind: str = "principled"
    base_color: Triple = (0.5, 0.5, 0.5)
    metallic: float = 0.0
    roughness: float = 0.5
    anisotropic: float = 0.0
    eta: float = 1.5
    spec_tint: float = 0.0
    spec_trans: float = 0.0
    sheen: float = 0.0
    sheen_tint: float = 0.0
    clearcoat: float = 0.0
    clearcoat_gloss: float = 0.0
    opacity: float = 1.0
    # Emitted by the front, or by both sides.
    radiance: Triple = (0.0, 0.0, 0.0)
    two_sided_light: bool = False
    medium: Medium | None = None

    @property
    def is_solid(self) -> bool:
        """Does light pass into the shape and out again?"""
        return self.kind == "dielectric" or self.spec_trans > 0.0


@dataclass
class Shape:
    """A triangle mesh in world coordinates, front faces counter-clockwise, with a material's name."""

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    material: str
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None


@dataclass(frozen=True)
class Textures:
    """8-bit images (rows, columns, RGB) of a material: base colour in sRGB, tangent-space normals."""

    color: np.ndarray | None = None
    normals: np.ndarray | None = None


@dataclass(frozen=True)
class Light:
    """A light without extent: `strength` is W/sr, or W/m^2 for a directional one."""

    # "point", "spot" or "directional".
    kind: str
    position: Triple
    target: Triple
    strength: Triple
    # Half-angles in radians; the ramp between them is squared in the cosine, as glTF has it.
    inner: float = 0.0
    outer: float = 0.0


@dataclass(frozen=True)
class Camera:
    """Looks from `eye` to `target`; `yfov` in radians, or half the film's height in metres if orthographic."""

    eye: Triple = (0.55, 1.0, 1.7)
    target: Triple = (0.0, 0.32, 0.0)
    yfov: float = math.radians(30.0)
    half_height: float | None = None
    # Thin lens: radius of the aperture and distance of the plane in focus, in metres.
    aperture: float = 0.0
    focus: float = 0.0
    # Where the optical axis meets the film: from its middle to the right and down, in shares of its width and height.
    principal_point: tuple[float, float] = (0.0, 0.0)

    def to_world(self) -> np.ndarray:
        """Camera to world: looks along -z with +y up."""
        return _frame(self.eye, self.target)


@dataclass
class Scene:
    """Everything there is. `stage` names the glTF file: scenes with the same shapes, lights and camera share it."""

    stage: str
    shapes: list[Shape]
    materials: dict[str, Material]
    textures: dict[str, Textures] = field(default_factory=dict)
    lights: list[Light] = field(default_factory=list)
    # A constant, or an equirectangular image (rows, columns, RGB) whose centre looks along -z.
    environment: Triple | np.ndarray | None = None
    camera: Camera = Camera()


def _frame(eye: Triple, target: Triple) -> np.ndarray:
    matrix = np.eye(4)
    back = np.subtract(eye, target)
    back = back / np.linalg.norm(back)
    # Straight up or down has no upright picture: then -z is up.
    up = np.array([0.0, 1.0, 0.0]) if abs(back[1]) < 0.999 else np.array([0.0, 0.0, -1.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(back, right), back, eye
    return matrix


# --- shapes -------------------------------------------------------------------------------------------------------------


def quad(name: str, material: str, corner: Triple, u: Triple, v: Triple) -> Shape:
    """A parallelogram from a corner with sides u and v; its front is where u x v points. Texture coordinates (0, 0) at
    the corner plus v, so that an image stands upright with u to the right and v up."""
    corner, u, v = (np.array(x, dtype=float) for x in (corner, u, v))
    positions = np.array([corner, corner + u, corner + u + v, corner + v])
    uvs = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    return Shape(name, positions, np.array([[0, 1, 2], [0, 2, 3]]), material, uvs=uvs)


def box(name: str, material: str, center: Triple, size: Triple, turn: float = 0.0) -> Shape:
    """A closed box with flat faces, turned about +y."""
    positions, triangles = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            n, u, v = np.zeros(3), np.zeros(3), np.zeros(3)
            n[axis], u[(axis + 1) % 3], v[(axis + 2) % 3] = sign, sign, 1.0
            first = len(positions)
            positions += [0.5 * (n + a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    s, c = math.sin(turn), math.cos(turn)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return Shape(name, np.array(positions) * size @ rotation.T + center, np.array(triangles), material)


def ball(name: str, material: str, center: Triple, radius: float, smooth: bool = False, rounds: int = 2) -> Shape:
    """An icosahedron, divided `rounds` times and blown up to a sphere. Its facets are flat, so that they show the BSDF at
    all angles and no interpolated normal can disagree with the surface; their texture coordinates are longitude and
    latitude, without a seam inside any of them. If `smooth`, it has the sphere's normals instead."""
    g = 0.5 * (1.0 + math.sqrt(5.0))
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-g, g)]
    corners = [v for a, b in signs for v in ([0.0, a, b], [a, b, 0.0], [b, 0.0, a])]
    points = np.array(corners) / math.hypot(1.0, g)
    edge = min(float(np.linalg.norm(points[0] - p)) for p in points[1:])
    near = lambda i, j: abs(float(np.linalg.norm(points[i] - points[j])) - edge) < 1e-6
    faces = [
        points[[i, j, k]]
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near(i, j) and near(j, k) and near(i, k)
    ]
    for _ in range(rounds):
        divided = []
        for a, b, c in faces:
            ab, bc, ca = (m / np.linalg.norm(m) for m in (a + b, b + c, c + a))
            divided += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        faces = divided
    # Turned a little, so that no vertex or edge lies on an axis.
    turn = _frame((0.3, 0.5, 0.8), (0.0, 0.0, 0.0))[:3, :3]
    soup = np.array(faces) @ turn.T
    outward = np.einsum("ij,ij->i", np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0]), soup.sum(axis=1)) > 0.0
    soup = np.where(outward[:, None, None], soup, soup[:, ::-1])
    if smooth:
        directions, triangles = np.unique(np.round(soup.reshape(-1, 3), 9), axis=0, return_inverse=True)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return Shape(name, directions * radius + center, triangles.reshape(-1, 3), material, directions)
    u = np.arctan2(soup[..., 0], -soup[..., 2]) / (2.0 * math.pi)
    u -= np.round(u - u[:, :1])
    uvs = np.stack([u, np.arccos(np.clip(soup[..., 1], -1.0, 1.0)) / math.pi], axis=-1).reshape(-1, 2)
    triangles = np.arange(uvs.shape[0]).reshape(-1, 3)
    return Shape(name, soup.reshape(-1, 3) * radius + center, triangles, material, uvs=uvs)


# --- for our renderer ---------------------------------------------------------------------------------------------------


def write(scene: Scene, job: Path, width: int, height: int) -> None:
    """Writes the job and beside it the stage's glTF file and what else it names."""
    job.parent.mkdir(parents=True, exist_ok=True)
    (job.parent / f"{scene.stage}.glb").write_bytes(_glb(scene))
    environment = ""
    if isinstance(scene.environment, np.ndarray):
        image = job.with_suffix(".sky.hdr")
        image.write_bytes(_radiance_hdr(scene.environment))
        environment = f'\n[environment]\nimage = "{image.name}"\n'
    elif scene.environment is not None:
        environment = f"\n[environment]\nradiance = {_toml(scene.environment)}\n"
    lines = [f'scene = "{scene.stage}.glb"', "", "[film]", f"width = {width}", f"height = {height}"]
    lens: list[str] = []
    if scene.camera.aperture > 0.0:
        lines += [f"sensor_height = {FILM_HEIGHT}"]
        lens += [f"f_number = {_toml(_f_number(scene.camera))}", f"focus_distance = {_toml(scene.camera.focus)}"]
    if any(scene.camera.principal_point):
        right, down = scene.camera.principal_point
        lens += [f"principal_point = {_toml((right * width, down * height))}"]
    if lens:
        lines += ["", "[lens]", *lens]
    text = "\n".join([*lines, "", "[sensor]", 'model = "none"', "", "[render]", 'principled = "mitsuba"', ""]) + environment
    for name, material in scene.materials.items():
        text += "\n[[material]]\n" + "".join(f"{k} = {_toml(v)}\n" for k, v in _job_material(name, material).items())
    for index, light in enumerate(scene.lights):
        key = "irradiance" if light.kind == "directional" else "intensity"
        text += f'\n[[light]]\nname = "light {index}"\n{key} = {_toml(light.strength)}\n'
    job.write_text(text)


def _f_number(camera: Camera) -> float:
    """That of a lens with the camera's field, focus and aperture before a film of `FILM_HEIGHT`, by the thin-lens
    equation."""
    image_distance = 0.5 * FILM_HEIGHT / math.tan(0.5 * camera.yfov)
    focal_length = 1.0 / (1.0 / camera.focus + 1.0 / image_distance)
    return focal_length / (2.0 * camera.aperture)


def _job_material(name: str, m: Material) -> dict[str, Any]:
    """The keys of a job's `[[material]]`."""
    keys: dict[str, Any] = {"name": name, "base_color": m.base_color, "roughness": m.roughness, "ior": m.eta}
    if m.kind == "black":
        keys = {"name": name, "base_color": (0.0, 0.0, 0.0), "metallic": 0.0, "specular": 0.0}
    elif m.kind in ("dielectric", "thin"):
        keys |= {"metallic": 0.0, "transmission": 1.0, "solid": m.kind == "dielectric"}
    else:
        # Sheen takes its colour from the base colour's hue, in proportion to the tint (Burley 2012).
        luminance = float(np.dot(m.base_color, (0.2126, 0.7152, 0.0722)))
        hue = [c / luminance if luminance > 0.0 else 1.0 for c in m.base_color]
        keys |= {
            "metallic": m.metallic,
            "anisotropy": m.anisotropic,
            "specular_tint": m.spec_tint,
            "sheen_color": tuple(m.sheen * (1.0 + m.sheen_tint * (h - 1.0)) for h in hue),
            # Mitsuba's coat of strength one has a quarter of a lacquer's reflectance; its gloss runs from alpha 0.1 to 0.001.
            "clearcoat": 0.25 * m.clearcoat,
            "clearcoat_roughness": math.sqrt(0.1 - 0.099 * m.clearcoat_gloss),
        }
        if m.spec_trans > 0.0:
            keys |= {"transmission": m.spec_trans, "solid": True}
    if m.opacity < 1.0:
        keys |= {"alpha": m.opacity, "alpha_mode": "blend"}
    if any(m.radiance):
        keys |= {"emission": m.radiance, "double_sided": m.two_sided_light}
    if m.medium is not None and any(m.medium.scattering):
        keys |= {key: tuple(f"{v:g}/m" for v in getattr(m.medium, key)) for key in ("absorption", "scattering")}
        keys["scattering_anisotropy"] = m.medium.anisotropy
    elif m.medium is not None:
        # What is left of white light after a decimetre.
        keys |= {"attenuation_color": tuple(math.exp(-0.1 * a) for a in m.medium.absorption)}
        keys["attenuation_distance"] = 0.1
    return keys


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return repr(round(float(value), 9))


def _glb(scene: Scene) -> bytes:
    """Shapes, camera, lights and textures; materials by name, everything else about them is the job's."""
    binary = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []

    def view(data: bytes) -> int:
        binary.extend(b"\0" * (-len(binary) % 4))
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        binary.extend(data)
        return len(views) - 1

    def accessor(values: np.ndarray, kind: str, code: int, **more: Any) -> int:
        dtype = {5126: "<f4", 5123: "<u2"}[code]
        place = view(np.ascontiguousarray(values, dtype=dtype).tobytes())
        count = values.shape[0]
        accessors.append({"bufferView": place, "componentType": code, "count": count, "type": kind, **more})
        return len(accessors) - 1

    names = sorted(scene.materials)
    images: list[dict[str, Any]] = []

    def texture(pixels: np.ndarray) -> dict[str, Any]:
        images.append({"bufferView": view(_png(pixels)), "mimeType": "image/png"})
        return {"index": len(images) - 1}

    materials = []
    for name in names:
        entry: dict[str, Any] = {"name": name}
        textures = scene.textures.get(name, Textures())
        if textures.color is not None:
            entry["pbrMetallicRoughness"] = {"baseColorTexture": texture(textures.color)}
        if textures.normals is not None:
            entry["normalTexture"] = texture(textures.normals)
        materials.append(entry)

    nodes: list[dict[str, Any]] = []
    meshes = []
    for shape in scene.shapes:
        p = shape.positions.astype(np.float32)
        bounds = {"min": p.min(axis=0).tolist(), "max": p.max(axis=0).tolist()}
        attributes = {"POSITION": accessor(p, "VEC3", 5126, **bounds)}
        if shape.normals is not None:
            attributes["NORMAL"] = accessor(shape.normals, "VEC3", 5126)
        if shape.uvs is not None:
            attributes["TEXCOORD_0"] = accessor(shape.uvs, "VEC2", 5126)
        indices = accessor(shape.triangles.reshape(-1), "SCALAR", 5123)
        primitive = {"attributes": attributes, "indices": indices, "material": names.index(shape.material)}
        nodes.append({"name": shape.name, "mesh": len(meshes)})
        meshes.append({"primitives": [primitive]})

    document: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "meshes": meshes, "materials": materials}
    if images:
        document |= {"images": images, "textures": [{"source": i, "sampler": 0} for i in range(len(images))]}
        document["samplers"] = [{"magFilter": 9729, "wrapS": 10497, "wrapT": 10497}]
    camera = scene.camera
    if camera.half_height is None:
        projection = {"type": "perspective", "perspective": {"yfov": camera.yfov, "znear": 0.01}}
    else:
        half = {"xmag": camera.half_height, "ymag": camera.half_height, "znear": 0.01, "zfar": 100.0}
        projection = {"type": "orthographic", "orthographic": half}
    document["cameras"] = [{"name": "camera", **projection}]
    nodes.append({"name": "camera", "camera": 0, "matrix": camera.to_world().T.reshape(-1).tolist()})
    if scene.lights:
        lights = []
        for index, light in enumerate(scene.lights):
            entry = {"name": f"light {index}", "type": light.kind, "intensity": LUMENS_PER_WATT}
            if light.kind == "spot":
                entry["spot"] = {"innerConeAngle": light.inner, "outerConeAngle": light.outer}
            lights.append(entry)
            matrix = _frame(light.position, light.target).T.reshape(-1).tolist()
            extension = {"KHR_lights_punctual": {"light": index}}
            nodes.append({"name": f"light {index}", "matrix": matrix, "extensions": extension})
        document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        document["extensionsUsed"] = ["KHR_lights_punctual"]
    document |= {"nodes": nodes, "scenes": [{"nodes": list(range(len(nodes)))}], "accessors": accessors}
    document |= {"bufferViews": views, "buffers": [{"byteLength": len(binary)}]}
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary.extend(b"\0" * (-len(binary) % 4))
    length = 12 + 8 + len(text) + 8 + len(binary)
    header = struct.pack("<4sII", b"glTF", 2, length) + struct.pack("<I4s", len(text), b"JSON")
    return header + text + struct.pack("<I4s", len(binary), b"BIN\0") + bytes(binary)


def _png(pixels: np.ndarray) -> bytes:
    import io

    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG", optimize=True)
    return stream.getvalue()


def _radiance_hdr(image: np.ndarray) -> bytes:
    """The flat form of Ward's (1991) RGBE format."""
    height, width, _ = image.shape
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + to_rgbe(image).tobytes()


def to_rgbe(image: np.ndarray) -> np.ndarray:
    """Shared-exponent bytes, rounded to nearest."""
    exponent = np.frexp(image.max(axis=-1, keepdims=True))[1]
    mantissa = np.clip(np.round(np.ldexp(image, 8 - exponent)), 0, 255)
    return np.concatenate([mantissa, exponent + 128], axis=-1).astype(np.uint8)


def from_rgbe(bytes_: np.ndarray) -> np.ndarray:
    """What shared-exponent bytes stand for."""
    exponent = bytes_[..., 3:].astype(int) - 136
    return np.ldexp(bytes_[..., :3].astype(float), exponent)
