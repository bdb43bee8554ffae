"""Renders scenes with Cycles, in a process of its own: `bpy` and `mitsuba` need different versions of NumPy.

    python cycles_worker.py

Reads one JSON object a line and answers each with one line on the standard output that the process got. All else that
Blender prints goes to the standard error.

    {"station": "plates", "size": 192}              builds a scene of `stations.py`
    {"scene": "inspection.glb", "size": 192}        builds a shipped scene
    {"spp": 32, "seed": 1, "file": "a.exr"}         renders, writes linear RGB, answers {"seconds": processor seconds}

Settings: no bound on the depth that matters, no clamping, no filter on glossy paths, light tree, box filter of one pixel, the same
number of samples in every pixel. Scenes keep their metres and +y up; radiance is in W/(m^2 sr).

Mapping
    opaque       Lambert's diffuse + GGX with the Fresnel term of the index, added as in Mitsuba's `principled`, whose diffuse
                 part follows Burley (2012): its albedo under an even sky is that of ours here, its angles are not
    metallic     GGX with Schlick's Fresnel term, single scattering
    dielectric   a smooth glass
    coverage     a mix with transparency
    emission     rectangles become area lights, with a black sheet behind them; other lights are meshes, dark at the back
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np

import mitsuba_scene
from parity_scene import Material, Shape, Triple
from stations import STATIONS

BOUNCES = 256
# Distance in metres between an area light and the sheet behind it.
BACK = 5e-5


def burley_albedo(roughness: float) -> float:
    """Albedo of Burley's (2012) diffuse term under an even sky, in units of the base colour. Lambert's is 1."""
    n = 48
    cosine = (np.arange(n) + 0.5) / n
    turn = math.pi * (np.arange(n) + 0.5) / n
    i, o, phi = np.meshgrid(cosine, cosine, turn, indexing="ij")
    # cos^2 of half the angle between both directions.
    half = 0.5 * (1.0 + i * o + np.sqrt((1.0 - i * i) * (1.0 - o * o)) * np.cos(phi))
    grazing = 0.5 + 2.0 * roughness * half - 1.0
    lobe = (1.0 + grazing * (1.0 - i) ** 5) * (1.0 + grazing * (1.0 - o) ** 5)
    return float((lobe * i * o).mean() / (i * o).mean())


def shader(name: str, m: Material) -> Any:
    """Blender's material."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")

    def joined(kind: str, a: Any, b: Any) -> Any:
        node = nodes.new(kind)
        inputs = [s for s in node.inputs if s.type == "SHADER"]
        links.new(a, inputs[0])
        links.new(b, inputs[1])
        return node

    def colored(kind: str, color: Any) -> Any:
        node = nodes.new(kind)
        node.inputs["Color"].default_value = (*color, 1.0)
        return node

    unsupported = m.spec_trans or m.sheen or m.clearcoat or m.spec_tint or m.medium
    surface: Any
    if m.kind == "black":
        surface = colored("ShaderNodeBsdfDiffuse", (0.0, 0.0, 0.0)).outputs[0]
    elif m.kind == "dielectric" and m.roughness == 0.0 and m.base_color == (1.0, 1.0, 1.0):
        glass = colored("ShaderNodeBsdfGlass", m.base_color)
        glass.inputs["Roughness"].default_value = 0.0
        glass.inputs["IOR"].default_value = m.eta
        surface = glass.outputs[0]
    elif m.kind == "principled" and m.metallic in (0.0, 1.0) and not unsupported:
        gloss = nodes.new("ShaderNodeBsdfPrincipled")
        gloss.distribution = "GGX"
        color = m.base_color if m.metallic else (0.0, 0.0, 0.0)
        gloss.inputs["Base Color"].default_value = (*color, 1.0)
        gloss.inputs["Metallic"].default_value = m.metallic
        gloss.inputs["Roughness"].default_value = m.roughness
        gloss.inputs["IOR"].default_value = m.eta
        gloss.inputs["Anisotropic"].default_value = m.anisotropic
        if m.anisotropic:
            tangent = nodes.new("ShaderNodeTangent")
            tangent.direction_type, tangent.uv_map = "UV_MAP", "uv"
            links.new(tangent.outputs[0], gloss.inputs["Tangent"])
        surface = gloss.outputs[0]
        if not m.metallic:
            diffuse = colored("ShaderNodeBsdfDiffuse", np.multiply(m.base_color, burley_albedo(m.roughness)))
            surface = joined("ShaderNodeAddShader", surface, diffuse.outputs[0]).outputs[0]
    else:
        raise NotImplementedError(f"{name}: {m}")
    if m.opacity < 1.0:
        mix = joined("ShaderNodeMixShader", colored("ShaderNodeBsdfTransparent", (1.0, 1.0, 1.0)).outputs[0], surface)
        mix.inputs["Fac"].default_value = m.opacity
        surface = mix.outputs[0]
    if any(m.radiance):
        emission = colored("ShaderNodeEmission", m.radiance)
        geometry = nodes.new("ShaderNodeNewGeometry")
        front = nodes.new("ShaderNodeMath")
        front.operation = "SUBTRACT"
        front.inputs[0].default_value = 1.0
        links.new(geometry.outputs["Backfacing"], front.inputs[1])
        links.new(front.outputs[0], emission.inputs["Strength"])
        surface = joined("ShaderNodeAddShader", surface, emission.outputs[0]).outputs[0]
        material.cycles.emission_sampling = "FRONT"
    links.new(surface, output.inputs["Surface"])
    return material


def gltf_material(material: dict[str, Any]) -> Material:
    """A material of a shipped scene, as `mitsuba_scene.bsdf` reads it."""
    surface = mitsuba_scene.bsdf(material)
    red, green, blue = mitsuba_scene.radiance(material)
    if surface["type"] == "dielectric":
        return Material(kind="dielectric", base_color=(1.0, 1.0, 1.0), roughness=0.0, eta=surface["int_ior"])
    parameters = surface.get("nested", surface)["bsdf"]
    return Material(
        base_color=tuple(parameters["base_color"]["value"]),
        metallic=parameters["metallic"],
        roughness=parameters["roughness"],
        opacity=surface.get("opacity", 1.0),
        radiance=(red, green, blue),
    )


def rectangle_of(shape: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Corner and sides u, v of a rectangle whose front is where u x v points; nothing for other shapes."""
    points, place = np.unique(np.round(shape.positions[shape.triangles].reshape(-1, 3), 7), axis=0, return_inverse=True)
    first, second = place.reshape(-1, 3)[:2] if len(place.ravel()) == 6 else ((), ())
    if len(points) != 4 or len(set(first) & set(second)) != 2:
        return None
    k = next(k for k in range(3) if first[k] not in second)
    corner, a, b = (points[first[(k + j) % 3]] for j in range(3))
    opposite = points[next(i for i in second if i not in first)]
    u, v = a - corner, b - corner
    size = math.sqrt(float(u @ u) * float(v @ v))
    is_rectangle = np.abs(corner + u + v - opposite).max() < 1e-6 and abs(float(u @ v)) < 1e-4 * size
    return (corner, u, v) if is_rectangle else None


def add_object(name: str, data: Any) -> Any:
    """Links new data into the scene."""
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_mesh(shape: Shape, material: Any) -> None:
    """A triangle mesh with its normals and texture coordinates."""
    mesh = bpy.data.meshes.new(shape.name)
    mesh.from_pydata(shape.positions.tolist(), [], shape.triangles.tolist())
    mesh.materials.append(material)
    if shape.uvs is not None:
        layer = mesh.uv_layers.new(name="uv")
        # Blender's images stand on the lower edge.
        layer.data.foreach_set("uv", (shape.uvs[shape.triangles.ravel()] * [1.0, -1.0] + [0.0, 1.0]).ravel())
    if shape.normals is not None:
        mesh.shade_smooth()
        mesh.normals_split_custom_set_from_vertices(shape.normals.tolist())
    add_object(shape.name, mesh)


def add_light(name: str, rectangle: tuple[np.ndarray, np.ndarray, np.ndarray], radiance: Triple) -> np.ndarray:
    """An area light that shines from the front of a rectangle (corner, sides) into all directions. Gives its unit normal."""
    corner, u, v = rectangle
    light = bpy.data.lights.new(name, "AREA")
    light.shape = "RECTANGLE"
    light.size, light.size_y = (float(np.linalg.norm(side)) for side in (u, v))
    # Radiant power [W] of a Lambertian source.
    light.energy = max(radiance) * math.pi * light.size * light.size_y
    light.color = np.divide(radiance, max(radiance)).tolist()
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    matrix = np.eye(4)
    # Blender's lights shine along -z.
    matrix[:3, 0], matrix[:3, 2] = u / light.size, -normal
    matrix[:3, 1] = np.cross(matrix[:3, 2], matrix[:3, 0])
    matrix[:3, 3] = corner + 0.5 * (u + v)
    add_object(name, light).matrix_world = mathutils.Matrix(matrix.tolist())
    return normal


def prepare(to_world: np.ndarray, yfov: float, size: int, choices: dict[str, Any]) -> None:
    """An empty scene with a camera and the settings of Cycles; `choices` replaces some of them."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "NONE"
    settings = {
        "device": "CPU",
        "use_adaptive_sampling": False,
        "use_denoising": False,
        "pixel_filter_type": "BOX",
        "sample_clamp_direct": 0.0,
        "sample_clamp_indirect": 0.0,
        "blur_glossy": 0.0,
        "caustics_reflective": True,
        "caustics_refractive": True,
        "light_sampling_threshold": 0.0,
        "max_bounces": BOUNCES,
        "diffuse_bounces": BOUNCES,
        "glossy_bounces": BOUNCES,
        "transmission_bounces": BOUNCES,
        "transparent_max_bounces": BOUNCES,
    }
    for key, value in (settings | choices).items():
        setattr(scene.cycles, key, value)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "VERTICAL"
    camera.angle_y = yfov
    camera.clip_start, camera.clip_end = 0.001, 100.0
    scene.camera = add_object("camera", camera)
    scene.camera.matrix_world = mathutils.Matrix(to_world.tolist())


def build(command: dict[str, Any]) -> None:
    """The scene of a command."""
    choices = dict(command["settings"])
    manifolds = choices.pop("manifolds", False)
    if "station" in command:
        station = STATIONS[command["station"]]()
        prepare(station.camera.to_world(), station.camera.yfov, command["size"], choices)
        definitions, shapes = station.materials, station.shapes
    else:
        glb = mitsuba_scene.Glb(Path(command["scene"]))
        camera = glb.camera()
        prepare(camera.to_world, camera.yfov, command["size"], choices)
        placed = list(glb.placed())
        definitions = {p.material["name"]: gltf_material(p.material) for p in placed}
        shapes = [Shape(p.name, p.positions, p.triangles, p.material["name"], p.normals) for p in placed]
    clear = {name for name, m in definitions.items() if m.kind == "dielectric"}
    materials: dict[str, Any] = {}
    for shape in shapes:
        definition = definitions[shape.material]
        rectangle = rectangle_of(shape) if any(definition.radiance) else None
        if rectangle is not None:
            normal = add_light(shape.name, rectangle, definition.radiance)
            definition = replace(definition, radiance=(0.0, 0.0, 0.0))
            shape = replace(shape, positions=shape.positions - BACK * normal)
        if shape.material not in materials:
            materials[shape.material] = shader(shape.material, definition)
        add_mesh(shape, materials[shape.material])
    if manifolds:
        for thing in bpy.context.scene.objects:
            if thing.type == "LIGHT":
                thing.data.cycles.is_caustics_light = True
            elif thing.type == "MESH":
                is_clear = thing.active_material.name.split(".")[0] in clear
                thing.cycles.is_caustics_caster, thing.cycles.is_caustics_receiver = is_clear, not is_clear


def render(command: dict[str, Any]) -> float:
    """Renders into a file; processor seconds."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = command["spp"], command["seed"]
    scene.render.filepath = command["file"]
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    return time.process_time() - start


def main() -> int:
    """Answers commands until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    print(json.dumps({"version": bpy.app.version_string}), file=answers, flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        answer: dict[str, Any] = {}
        if "spp" in command:
            answer["seconds"] = render(command)
        else:
            build(command)
        print(json.dumps(answer), file=answers, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
