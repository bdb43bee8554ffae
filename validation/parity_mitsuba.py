"""Makes the scenes of `parity_scene.py` Mitsuba's. Set the variant first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parity_scene import Camera, Light, Material, Scene, Shape, Textures, from_rgbe, to_rgbe

# A texel of our environment maps has one radiance, Mitsuba's are interpolated: each texel becomes this many squared.
TEXEL = 48
# Distance in metres between the two sides of a light: more than Mitsuba moves the origins of rays.
BACK = 4e-4


def load(scene: Scene, width: int, height: int, rr_depth: int = 24, sampler: str = "independent") -> Any:
    """Builds the scene."""
    import mitsuba as mi

    # Unbounded depth; roulette does not change the mean. In a coloured medium `volpath` weighs paths by one channel, which
    # `volpathmis` does not: the same mean with far less noise.
    integrator = "volpathmis" if any(m.medium for m in scene.materials.values()) else "path"
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": integrator, "max_depth": -1, "rr_depth": rr_depth},
        "sensor": _sensor(scene.camera, width, height) | {"sampler": {"type": sampler, "sample_count": 1}},
    }
    bsdfs = {name: mi.load_dict(_bsdf(m, scene.textures.get(name, Textures()))) for name, m in scene.materials.items()}
    for index, shape in enumerate(scene.shapes):
        material = scene.materials[shape.material]
        parts[f"shape-{index}"] = _mesh(shape, material, bsdfs[shape.material])
        if any(material.radiance) and material.two_sided_light:
            back = Shape(shape.name, shape.positions + _behind(shape), shape.triangles[:, ::-1], shape.material)
            parts[f"shape-{index}-back"] = _mesh(back, material, bsdfs[shape.material])
    for index, light in enumerate(scene.lights):
        parts[f"light-{index}"] = _light(light)
    if isinstance(scene.environment, np.ndarray):
        parts["environment"] = _sky(from_rgbe(to_rgbe(scene.environment)))
    elif scene.environment is not None:
        parts["environment"] = {"type": "constant", "radiance": _rgb(scene.environment)}
    return mi.load_dict(parts)


def _behind(shape: Shape) -> np.ndarray:
    """A step to the back of a flat shape: a light that shines to both sides becomes two, and neither may cover the other."""
    a, b, c = shape.positions[shape.triangles[0]]
    normal = np.cross(b - a, c - a)
    return -BACK * normal / np.linalg.norm(normal)


def _rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


def _bsdf(m: Material, textures: Textures) -> dict[str, Any]:
    if m.kind == "black":
        return {"type": "diffuse", "reflectance": _rgb((0.0, 0.0, 0.0))}
    if m.kind == "dielectric":
        # We tint by the root of the base colour at each face.
        root = _rgb([math.sqrt(c) for c in m.base_color])
        surface: dict[str, Any] = {"int_ior": m.eta, "ext_ior": 1.0, "specular_transmittance": root}
        if m.eta == 1.0:
            # Light goes straight through, and shadow rays may.
            return {"type": "null"}
        if m.roughness == 0.0:
            return {"type": "dielectric", **surface}
        return {"type": "roughdielectric", "distribution": "ggx", "alpha": m.roughness**2, **surface}
    if m.kind == "thin":
        index = {"int_ior": m.eta, "ext_ior": 1.0}
        return {"type": "thindielectric", "specular_transmittance": _rgb(m.base_color), **index}
    surface = {
        "type": "principled",
        "base_color": _rgb(m.base_color),
        "roughness": m.roughness,
        "metallic": m.metallic,
        "anisotropic": m.anisotropic,
        "eta": m.eta,
        "spec_tint": m.spec_tint,
        "spec_trans": m.spec_trans,
        "sheen": m.sheen,
        "sheen_tint": m.sheen_tint,
        "clearcoat": m.clearcoat,
        "clearcoat_gloss": m.clearcoat_gloss,
    }
    if textures.color is not None:
        surface["base_color"] = _bitmap(textures.color, raw=False)
    if textures.normals is not None:
        # Without the shadowing term of Estevez, Lecocq and Stein (2019), which is on by default.
        bumps = {"normalmap": _bitmap(textures.normals, raw=True), "use_shadowing_function": False}
        surface = {"type": "normalmap", **bumps, "bsdf": surface}
    if not m.is_solid:
        surface = {"type": "twosided", "bsdf": surface}
    return {"type": "mask", "opacity": m.opacity, "nested": surface} if m.opacity < 1.0 else surface


def _bitmap(pixels: np.ndarray, raw: bool) -> dict[str, Any]:
    import mitsuba as mi

    # Bilinear and repeated, in full precision.
    bitmap = mi.Bitmap(np.ascontiguousarray(pixels))
    bitmap.set_srgb_gamma(not raw)
    return {"type": "bitmap", "bitmap": bitmap, "raw": raw, "format": "variant"}


def _mesh(shape: Shape, material: Material, bsdf: Any) -> Any:
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = bsdf
    if any(material.radiance):
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": _rgb(material.radiance)})
    if material.medium is not None:
        properties["interior"] = mi.load_dict(_medium(material))
    mesh = mi.Mesh(
        shape.name,
        vertex_count=len(shape.positions),
        face_count=len(shape.triangles),
        has_vertex_normals=shape.normals is not None,
        has_vertex_texcoords=shape.uvs is not None,
        props=properties,
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = shape.positions.astype(np.float32).ravel()
    if shape.normals is not None:
        parameters["vertex_normals"] = shape.normals.astype(np.float32).ravel()
    if shape.uvs is not None:
        parameters["vertex_texcoords"] = shape.uvs.astype(np.float32).ravel()
    parameters["faces"] = shape.triangles.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def _medium(material: Material) -> dict[str, Any]:
    medium = material.medium
    assert medium is not None
    extinction = np.add(medium.absorption, medium.scattering)
    albedo = np.divide(medium.scattering, extinction, out=np.zeros(3), where=extinction > 0.0)
    volume = lambda value: {"type": "constvolume", "value": _rgb(value)}
    phase: dict[str, Any] = {"type": "hg", "g": medium.anisotropy} if medium.anisotropy else {"type": "isotropic"}
    return {"type": "homogeneous", "sigma_t": volume(extinction), "albedo": volume(albedo), "phase": phase}


def _light(light: Light) -> dict[str, Any]:
    import mitsuba as mi

    direction = np.subtract(light.target, light.position)
    if light.kind == "directional":
        return {"type": "directional", "direction": direction.tolist(), "irradiance": _rgb(light.strength)}
    if light.kind == "point":
        return {"type": "point", "position": list(light.position), "intensity": _rgb(light.strength)}
    # Mitsuba's own falloff is linear in the angle and cannot be glTF's: its cone is made hard and a little wider than ours,
    # and a picture that it projects has our falloff, or cuts our cone out.
    cutoff = light.outer * 1.02
    n = 2048
    x = (2.0 * (np.arange(n) + 0.5) / n - 1.0) * math.tan(cutoff)
    cosine = 1.0 / np.sqrt(1.0 + x[None, :] ** 2 + x[:, None] ** 2)
    width = max(math.cos(light.inner) - math.cos(light.outer), 1e-9)
    falloff = np.clip((cosine - math.cos(light.outer)) / width, 0.0, 1.0) ** 2
    picture = mi.Bitmap(np.repeat(falloff[..., None], 3, axis=-1).astype(np.float32))
    texture = {"type": "bitmap", "bitmap": picture, "raw": True, "format": "variant", "wrap_mode": "clamp"}
    up = [0.0, 1.0, 0.0] if abs(direction[1]) < 0.999 * np.linalg.norm(direction) else [0.0, 0.0, -1.0]
    return {
        "type": "spot",
        "intensity": _rgb(light.strength),
        "cutoff_angle": math.degrees(cutoff),
        "beam_width": math.degrees(cutoff) * 0.9999,
        "texture": texture,
        "to_world": mi.ScalarTransform4f().look_at(origin=list(light.position), target=list(light.target), up=up),
    }


def _sky(image: np.ndarray) -> dict[str, Any]:
    """Each texel drawn large. Mitsuba's first and last rows lie at the poles, so that its rows fall onto the borders of our
    texels: those get the mean of both sides. The middle of its map is where our seam is."""
    import mitsuba as mi

    height, width, _ = image.shape
    rows = np.arange(height * TEXEL + 1)
    below, above = (np.clip((rows + k) // TEXEL, 0, height - 1) for k in (0, -1))
    large = np.repeat(0.5 * (image[below] + image[above]), TEXEL, axis=1)
    large = np.roll(large, large.shape[1] // 2, axis=1)
    bitmap = mi.Bitmap(np.ascontiguousarray(large, dtype=np.float32))
    return {"type": "envmap", "bitmap": bitmap}


def _sensor(camera: Camera, width: int, height: int) -> dict[str, Any]:
    import mitsuba as mi

    # Mitsuba looks along +z with +x to the left: turn our frame by half a turn about y.
    to_world = camera.to_world() @ np.diag([-1.0, 1.0, -1.0, 1.0])
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    sensor: dict[str, Any] = {
        "film": film,
        "near_clip": 0.01,
        "far_clip": 100.0,
    }
    if camera.half_height is not None:
        # Mitsuba's film is two units wide before it is placed.
        scale = camera.half_height * width / height
        matrix = to_world @ np.diag([scale, scale, 1.0, 1.0])
        return {"type": "orthographic", "to_world": mi.ScalarTransform4f(matrix), **sensor}
    view = {"fov": math.degrees(camera.yfov), "fov_axis": "y", "to_world": mi.ScalarTransform4f(to_world), **sensor}
    if camera.aperture > 0.0:
        if any(camera.principal_point):
            raise NotImplementedError("a thin lens whose axis is off the film's middle: Mitsuba's has none")
        return {"type": "thinlens", "aperture_radius": camera.aperture, "focus_distance": camera.focus, **view}
    right, down = camera.principal_point
    # Mitsuba's offset is the place of the film's middle in the picture without it: the opposite sign.
    return {"type": "perspective", "principal_point_offset_x": -right, "principal_point_offset_y": -down, **view}
