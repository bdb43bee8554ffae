"""Writes the two parts of `examples/jobs/`: `part.glb` with texture coordinates along its grain, and `gear.stl`.

    python example_parts.py
"""

import io
import json
import math
import struct
from pathlib import Path

import numpy as np
from PIL import Image

FOLDER = Path(__file__).resolve().parent.parent / "examples" / "jobs"
TILE = 13.0  # mm for one tile of the relief
BASE, THICKNESS = 0.2, 4.0  # mm: the plate lies just above the table, so that clear plates do not touch it

Mesh = tuple[list, list, list, list, list]  # positions [mm], normals, tangents, texture coordinates, triangles


def arc(x: float, y: float, r: float, start: float, end: float, n: int, side: int = 1) -> list:
    """Points of a profile on an arc, with normals away from its centre, or toward it."""
    angles = np.radians(np.linspace(start, end, n))
    return [(x + r * math.cos(a), y + r * math.sin(a), side * math.cos(a), side * math.sin(a)) for a in angles]


def turned(profile: list, centre: tuple, segments: int) -> Mesh:
    """A profile (radius, height, normal) around the y axis; u runs around."""
    positions, normals, tangents, uvs, triangles = [], [], [], [], []
    length = 0.0
    for k, (r, h, across, up) in enumerate(profile):
        if k:
            length += math.hypot(r - profile[k - 1][0], h - profile[k - 1][1])
        for s in range(segments + 1):
            a = 2 * math.pi * s / segments
            c, d = math.cos(a), math.sin(a)
            positions.append((centre[0] + r * c, centre[1] + h, centre[2] - r * d))
            normals.append((across * c, up, -across * d))
            tangents.append((-d, 0, -c, 1))
            uvs.append((8 * a / TILE, -length / TILE))
    n = segments + 1
    for k in range(len(profile) - 1):
        for s in range(segments):
            a, b = k * n + s, (k + 1) * n + s
            if profile[k][0] > 0:
                triangles.append((a, a + 1, b + 1))
            if profile[k + 1][0] > 0:
                triangles.append((a, b + 1, b))
    return positions, normals, tangents, uvs, triangles


def plate(half: float, corner: float, fillet: float) -> Mesh:
    """A rounded square with rounded edges; u runs along x."""
    quarters = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    outline = []
    for q, (x, z) in enumerate(quarters):
        for s in range(7):
            a = math.pi / 2 * (q + s / 6)
            outline.append((x * (half - corner), z * (half - corner), math.cos(a), math.sin(a)))
    inner = corner - fillet
    rings = arc(inner, BASE + fillet, fillet, -90, 0, 7) + arc(inner, BASE + THICKNESS - fillet, fillet, 0, 90, 7)
    positions, normals, tangents, uvs, triangles = [], [], [], [], []

    def add(p: tuple, normal: tuple) -> None:
        tangent = np.array([1.0, 0, 0]) - normal[0] * np.array(normal)
        if np.linalg.norm(tangent) < 1e-3:
            tangent = np.array([0.0, 0, 1])
        positions.append(p)
        normals.append(normal)
        tangents.append((*(tangent / np.linalg.norm(tangent)), 1))
        uvs.append((p[0] / TILE, (p[2] - p[1]) / TILE))

    n = len(outline)
    for r, h, across, up in rings:
        for x, z, c, d in outline:
            add((x + r * c, h, -(z + r * d)), (across * c, up, -across * d))
    for k in range(len(rings) - 1):
        for s in range(n):
            a, b = k * n + s, k * n + (s + 1) % n
            triangles += [(a, b, b + n), (a, b + n, a + n)]
    for ring, up in ((rings[0], -1), (rings[-1], 1)):
        first = len(positions)
        add((0, ring[1], 0), (0, up, 0))
        for x, z, c, d in outline:
            add((x + ring[0] * c, ring[1], -(z + ring[0] * d)), (0, up, 0))
        for s in range(n):
            a, b = first + 1 + s, first + 1 + (s + 1) % n
            triangles.append((first, a, b) if up > 0 else (first, b, a))
    return positions, normals, tangents, uvs, triangles


def knob() -> list:
    """A cylinder with a rounded rim and a hollow in its top."""
    half = math.asin(5.5 / 10)
    middle = 11 + 10 * math.cos(half)
    profile = [(0, 0, 0, -1), (9, 0, 0, -1), (9, 0, 1, 0), (9, 9.5, 1, 0)]
    profile += [*arc(7.5, 9.5, 1.5, 0, 90, 6), (5.5, 11, 0, 1)]
    return profile + arc(0, middle, 10, math.degrees(half) - 90, -90, 7, side=-1)


def dome(r: float) -> list:
    return [(0, 0, 0, -1), (r, 0, 0, -1), *arc(0, 0, r, 0, 90, 9)]


def relief(n: int = 64) -> bytes:
    """A tile of cast skin: the normals of random heights, as PNG."""
    frequency = np.fft.fftfreq(n) * n
    k = np.hypot(*np.meshgrid(frequency, frequency))
    noise = np.fft.fft2(np.random.default_rng(1).normal(size=(n, n)))
    height = np.fft.ifft2(noise * np.exp(-((k / 20) ** 2)) / np.maximum(k, 4)).real
    dy, dx = (d[1:-1, 1:-1] for d in np.gradient(np.pad(height, 1, mode="wrap")))
    scale = 0.22 / np.sqrt((dx**2 + dy**2).mean())
    normal = np.dstack([-dx * scale, dy * scale, np.ones_like(dx)])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    file = io.BytesIO()
    Image.fromarray(np.round(127.5 + 127.5 * normal).astype(np.uint8)).save(file, "PNG", optimize=True)
    return file.getvalue()


class Glb:
    """A GLB with one material."""

    def __init__(self) -> None:
        self.blob = b""
        self.views, self.accessors, self.meshes = [], [], []

    def view(self, data: bytes) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)})
        self.blob += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def accessor(self, array: np.ndarray, kind: str) -> int:
        component = 5123 if array.dtype == np.uint16 else 5126
        accessor = {"bufferView": self.view(array.tobytes()), "componentType": component, "count": len(array)}
        accessor["type"] = kind
        if kind == "VEC3":
            accessor |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add(self, name: str, mesh: Mesh) -> None:
        positions, normals, tangents, uvs = (np.array(values, np.float32) for values in mesh[:4])
        attributes = {
            "POSITION": self.accessor((positions * 1e-3).astype(np.float32), "VEC3"),
            "NORMAL": self.accessor(normals, "VEC3"),
            "TANGENT": self.accessor(tangents, "VEC4"),
            "TEXCOORD_0": self.accessor(uvs, "VEC2"),
        }
        indices = self.accessor(np.array(mesh[4], np.uint16).ravel(), "SCALAR")
        self.meshes.append({"name": name, "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]})

    def finish(self, png: bytes) -> bytes:
        image = self.view(png)
        grey = {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0, "roughnessFactor": 0.5}
        nodes = [{"name": mesh["name"], "mesh": k} for k, mesh in enumerate(self.meshes)]
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(nodes)))}],
            "nodes": nodes,
            "meshes": self.meshes,
            "materials": [{"name": "part", "pbrMetallicRoughness": grey, "normalTexture": {"index": 0}}],
            "textures": [{"source": 0}],
            "images": [{"bufferView": image, "mimeType": "image/png"}],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.blob)}],
        }
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.blob))
        json_chunk = struct.pack("<I4s", len(text), b"JSON") + text
        return head + json_chunk + struct.pack("<I4s", len(self.blob), b"BIN\0") + self.blob


def gear(teeth: int = 20, module: float = 1.5, bore: float = 5.0, height: float = 5.0) -> bytes:
    """A spur gear with straight flanks and a bore as binary STL, in millimetres, with the z axis up."""
    pitch = teeth * module / 2
    radii = [pitch - 1.25 * module, pitch - 1.25 * module, pitch + module, pitch + module]
    outline, hole = [], []
    for tooth in range(teeth):
        for r, at in zip(radii, (-0.40, -0.33, -0.13, 0.13), strict=True):
            angle = 2 * math.pi * (tooth + at) / teeth
            outline.append((r * math.cos(angle), r * math.sin(angle)))
        angle = 2 * math.pi * (tooth + 0.33) / teeth
        outline.append((radii[0] * math.cos(angle), radii[0] * math.sin(angle)))
    for x, y in outline:
        angle = math.atan2(y, x)
        hole.append((bore * math.cos(angle), bore * math.sin(angle)))
    triangles = []
    n = len(outline)
    for k in range(n):
        a, b, c, d = outline[k], outline[(k + 1) % n], hole[(k + 1) % n], hole[k]
        quads = [
            ((*a, 0), (*b, 0), (*b, height), (*a, height)),
            ((*c, 0), (*d, 0), (*d, height), (*c, height)),
            ((*a, height), (*b, height), (*c, height), (*d, height)),
            ((*d, 0), (*c, 0), (*b, 0), (*a, 0)),
        ]
        triangles += [t for p, q, r, s in quads for t in ((p, q, r), (p, r, s))]
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *p, *q, *r, 0) for p, q, r in triangles)
    return b"gear, millimetres".ljust(80) + struct.pack("<I", len(triangles)) + facets


def main() -> None:
    glb = Glb()
    glb.add("part plate", plate(22, 4, 1.2))
    glb.add("part knob", turned(knob(), (-8, BASE + THICKNESS, -4), 56))
    for k, (x, z, r) in enumerate([(12, -11, 6), (13.5, 4, 5), (8, 14, 3.5)]):
        glb.add(f"part dome {k + 1}", turned(dome(r), (x, BASE + THICKNESS, z), 36))
    for name, content in (("part.glb", glb.finish(relief())), ("gear.stl", gear())):
        (FOLDER / name).write_bytes(content)
        print(f"{name}: {len(content)} bytes")


if __name__ == "__main__":
    main()
