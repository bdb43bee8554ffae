"""Small scenes for `blender.py`: builds one with Blender, exports it with the add-on, renders it with Cycles in batches.

    python blender_scenes.py SCENE FOLDER --spp 256 --batches 8

Needs the Python of `requirements-cycles.txt`. FOLDER gets SCENE.glb, SCENE.toml and SCENE-0.exr, SCENE-1.exr ... of different
seeds, linear Rec. 709, radiance in W/(m^2 sr). Nothing is filtered, clamped or denoised. SCENE-objects.exr has the number of the
object of each pixel, without the blur of the lens; 0 is the world. The last line on the standard output is the version of
Blender, the names of the objects, and the list of all that the export could not carry, as JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from pathlib import Path
from typing import Any, Callable

import bpy
import mathutils
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "integrations" / "blender"))

import dunkelfeld_export  # noqa: E402

SIZE = 96
BOUNCES = 64


def reset() -> Any:
    """An empty scene with the settings of Cycles."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
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
    for key, value in settings.items():
        setattr(scene.cycles, key, value)
    return scene


def material(name: str, kind: str, **inputs: Any) -> Any:
    """A material of one node. Spaces in the names of inputs are underscores."""
    result = bpy.data.materials.new(name)
    result.use_nodes = True
    tree = result.node_tree
    tree.nodes.clear()
    output, node = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new(kind)
    for key, value in inputs.items():
        socket = node.inputs[key.replace("_", " ")]
        socket.default_value = (*value, 1.0) if isinstance(value, tuple) and len(value) == 3 and socket.type == "RGBA" else value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return result


def diffuse(name: str, *color: float) -> Any:
    """A Lambertian material."""
    return material(name, "ShaderNodeBsdfDiffuse", Color=color)


def placed(data: Any, name: str, location: tuple, rotation: tuple = (0.0, 0.0, 0.0)) -> Any:
    """Links an object into the scene; Euler angles in degrees."""
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler = location, [math.radians(a) for a in rotation]
    bpy.context.scene.collection.objects.link(thing)
    return thing


def mesh(kind: str, name: str, shader: Any, location: tuple, size: float, rotation: tuple = (0.0, 0.0, 0.0)) -> Any:
    """A primitive mesh with a material; `size` is the side or the diameter."""
    import bmesh

    shape = bmesh.new()
    if kind == "plane":
        bmesh.ops.create_grid(shape, x_segments=1, y_segments=1, size=0.5 * size)
    elif kind == "cube":
        bmesh.ops.create_cube(shape, size=size)
    else:
        bmesh.ops.create_icosphere(shape, subdivisions=5, radius=0.5 * size)
    data = bpy.data.meshes.new(name)
    shape.to_mesh(data)
    shape.free()
    if kind == "sphere":
        data.shade_smooth()
    data.materials.append(shader)
    return placed(data, name, location, rotation)


def lamp(kind: str, name: str, location: tuple, rotation: tuple = (0.0, 0.0, 0.0), **settings: Any) -> Any:
    """A light. It shines along -z of its rotation."""
    data = bpy.data.lights.new(name, kind)
    if kind in ("POINT", "SPOT"):
        data.use_soft_falloff = False
    for key, value in settings.items():
        setattr(data, key, value)
    return placed(data, name, location, rotation)


def camera(position: tuple, target: tuple, **settings: Any) -> Any:
    """The camera, with +z up in its image."""
    data = bpy.data.cameras.new("camera data")
    data.clip_start = 0.01
    for key, value in settings.items():
        setattr(data, key, value)
    thing = placed(data, "camera", position)
    way = mathutils.Vector(target) - mathutils.Vector(position)
    thing.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = thing
    bpy.context.view_layer.update()
    return data


def world(color: tuple, strength: float = 1.0) -> Any:
    """An even world."""
    result = bpy.data.worlds.new("world")
    result.use_nodes = True
    background = result.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*color, 1.0)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = result
    return result


def station() -> None:
    """Floor and objects that most scenes have."""
    mesh("plane", "floor", diffuse("floor", 0.5, 0.5, 0.5), (0.0, 0.0, 0.0), 4.0)
    mesh("cube", "cube", diffuse("cube", 0.7, 0.4, 0.2), (-0.45, 0.1, 0.15), 0.3, (0.0, 0.0, 25.0))
    mesh("sphere", "sphere", diffuse("sphere", 0.2, 0.5, 0.7), (0.4, 0.1, 0.2), 0.4)
    camera((0.0, -2.2, 1.8), (0.0, 0.0, 0.1), lens=50.0)


def areas() -> None:
    """All shapes of area lights, with and without spread, scaled and turned."""
    camera((0.0, -1.0, 4.0), (0.0, 0.0, 0.0), lens=45.0)
    shapes = [
        ("SQUARE", 0.3, 0.3, math.pi, 10.0),
        ("RECTANGLE", 0.1, 0.6, math.radians(100.0), 6.0),
        ("DISK", 0.3, 0.3, math.radians(60.0), 3.0),
        ("ELLIPSE", 0.2, 0.5, math.pi, 8.0),
    ]
    for i, (shape, width, height, spread, power) in enumerate(shapes):
        x, y = (-0.7, 0.7)[i % 2], (-0.7, 0.7)[i // 2]
        gray = diffuse(f"gray {shape.lower()}", 0.6, 0.5, 0.4)
        mesh("plane", f"under {shape.lower()}", gray, (x, y, 0.0), 1.3)
        light = lamp("AREA", shape.lower(), (x, y, 0.8), (20.0, 10.0 * i, 30.0), shape=shape, size=width, size_y=height, spread=spread)
        light.data.energy, light.data.color = power, (1.0, 0.8, 0.6)
        mesh("sphere", f"ball {shape.lower()}", gray, (x + 0.25, y, 0.1), 0.2)
        light.scale = (1.5, 0.8, 2.0) if shape == "RECTANGLE" else (1.0, 1.0, 1.0)


def point_and_spot() -> None:
    """A point light and spot lights with an extent."""
    station()
    lamp("POINT", "point", (-0.9, -1.2, 1.2), energy=40.0, shadow_soft_size=0.08, color=(1.0, 0.9, 0.7))
    spot = {"spot_size": math.radians(50.0), "spot_blend": 0.4}
    lamp("SPOT", "spot", (0.8, -0.5, 1.2), (25.0, 30.0, 0.0), energy=60.0, shadow_soft_size=0.05, color=(0.6, 0.8, 1.0), **spot)


def sun() -> None:
    """A sun with soft shadows, and one without extent."""
    station()
    lamp("SUN", "sun", (0.0, 0.0, 3.0), (35.0, 20.0, 0.0), energy=3.0, angle=math.radians(12.0))
    lamp("SUN", "parallel", (0.0, 0.0, 3.0), (-20.0, -40.0, 0.0), energy=1.0, angle=0.0, color=(0.4, 0.6, 1.0))


def emission() -> None:
    """Emitting meshes under a weak world; matte, plastic and metal."""
    station()
    world((0.2, 0.3, 0.5), 0.5)
    mesh("plane", "panel", material("panel", "ShaderNodeEmission", Strength=6.0, Color=(1.0, 0.9, 0.8)), (0.0, 0.3, 1.2), 0.7)
    plastic = material("plastic", "ShaderNodeBsdfPrincipled", Base_Color=(0.6, 0.3, 0.1), Roughness=0.5)
    mesh("cube", "plastic", plastic, (0.0, -0.35, 0.1), 0.2, (0.0, 0.0, 40.0))
    metal = material("metal", "ShaderNodeBsdfPrincipled", Base_Color=(0.8, 0.7, 0.6), Metallic=1.0, Roughness=0.4)
    mesh("sphere", "metal", metal, (-0.1, 0.4, 0.15), 0.3)


def hdr() -> None:
    """A world from an image, turned by a mapping node."""
    station()
    height, width = 64, 128
    rows, columns = np.mgrid[0:height, 0:width]
    pixels = np.ones((height, width, 4), np.float32)
    # Blender's rows begin at the bottom: a bright window above the horizon, and a colour that changes around it.
    window = (rows > 38) & (rows < 50) & (columns > 20) & (columns < 40)
    pixels[..., 0] = 0.2 + 0.2 * np.sin(2.0 * math.pi * columns / width) + 12.0 * window
    pixels[..., 1] = 0.3 + 12.0 * window
    pixels[..., 2] = 0.2 + 0.5 * rows / height + 6.0 * window
    image = bpy.data.images.new("hall", width, height, float_buffer=True)
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    place = world((1.0, 1.0, 1.0), 0.8)
    nodes, links = place.node_tree.nodes, place.node_tree.links
    texture, mapping, coordinates = (nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord"))
    texture.image, texture.interpolation = image, "Linear"
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, math.radians(70.0))
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs[0], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])


def glass() -> None:
    """Clear and tinted glass, rough glass, and an absorbing volume."""
    mesh("plane", "floor", diffuse("floor", 0.5, 0.5, 0.5), (0.0, 0.0, 0.0), 4.0)
    camera((0.0, -2.2, 1.8), (0.0, 0.0, 0.1), lens=50.0)
    world((1.0, 0.9, 0.8), 1.0)
    clear = material("clear", "ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.0)
    tinted = material("tinted", "ShaderNodeBsdfPrincipled", Base_Color=(0.5, 0.8, 0.9), Roughness=0.0, IOR=1.45, Transmission_Weight=1.0)
    rough = material("rough", "ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.3)
    filled = material("filled", "ShaderNodeBsdfGlass", IOR=1.33, Roughness=0.0)
    tree = filled.node_tree
    absorption = tree.nodes.new("ShaderNodeVolumeAbsorption")
    absorption.inputs["Color"].default_value, absorption.inputs["Density"].default_value = (0.9, 0.5, 0.2, 1.0), 5.0
    tree.links.new(absorption.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    mesh("sphere", "clear sphere", clear, (-0.5, 0.2, 0.25), 0.4)
    mesh("cube", "tinted cube", tinted, (0.1, 0.3, 0.2), 0.3, (0.0, 0.0, 20.0))
    mesh("cube", "rough cube", rough, (-0.1, -0.4, 0.2), 0.25, (0.0, 0.0, 35.0))
    mesh("cube", "filled cube", filled, (0.6, 0.0, 0.2), 0.3, (0.0, 0.0, 50.0))


def dots(distances: tuple) -> None:
    """Emitting squares at several distances before a dark wall; the blur of a lens changes the radiance on them."""
    glow = material("glow", "ShaderNodeEmission", Strength=1.0, Color=(1.0, 0.7, 0.4))
    for i, y in enumerate(distances):
        mesh("plane", f"dot {i}", glow, ((-0.3, 0.25, 0.0)[i], y, (0.2, 0.1, -0.25)[i]), 0.16, (90.0, 0.0, 0.0))
    mesh("plane", "wall", diffuse("wall", 0.4, 0.4, 0.4), (0.0, 2.0, 0.0), 6.0, (90.0, 0.0, 0.0))
    world((0.3, 0.3, 0.3))


def depth_of_field() -> None:
    """A perspective with a finite aperture of six blades, shift, and a film that is not square."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 120, 80
    dots((-0.9, 0.0, 1.2))
    view = camera((0.1, -2.5, 0.1), (0.0, 0.0, 0.0), lens=100.0, sensor_width=50.0, shift_x=0.06, shift_y=-0.04)
    view.dof.use_dof, view.dof.focus_distance = True, 2.4
    view.dof.aperture_fstop, view.dof.aperture_blades, view.dof.aperture_rotation = 0.6, 6, 0.3


def orthographic() -> None:
    """An orthographic camera with depth of field, shift and vertical fit."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 120, 80
    dots((-0.9, 0.0, 1.2))
    view = camera((0.0, -2.5, 0.0), (0.0, 0.0, 0.0), sensor_fit="VERTICAL", shift_x=0.05, shift_y=0.1)
    view.type, view.ortho_scale = "ORTHO", 0.9
    view.dof.use_dof, view.dof.focus_distance, view.dof.aperture_fstop = True, 2.5, 16.0


def bench() -> None:
    """The scene of the picture: parts on a plate, even light, a low bar of light and a panel."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 400, 320
    mesh("plane", "plate", diffuse("plate", 0.18, 0.18, 0.18), (0.0, 0.0, 0.0), 4.0)
    plastic = material("plastic", "ShaderNodeBsdfPrincipled", Base_Color=(0.6, 0.6, 0.6), Roughness=0.35)
    metal = material("metal", "ShaderNodeBsdfPrincipled", Base_Color=(0.8, 0.8, 0.8), Metallic=1.0, Roughness=0.3)
    clear = material("clear", "ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.0)
    for i, x in enumerate((-0.35, 0.0, 0.35)):
        part = mesh("cube", f"part {i}", (plastic, metal, plastic)[i], (x, 0.3, 0.1), 0.2, (0.0, 0.0, 15.0 * i))
        bevel = part.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = 0.02, 4
        mesh("sphere", f"ball {i}", (metal, plastic, clear)[i], (x, -0.15, 0.1), 0.2)
    world((1.0, 1.0, 1.0), 0.15)
    bar = mesh("plane", "bar", material("bar", "ShaderNodeEmission", Strength=60.0), (0.0, 1.3, 0.7), 1.0, (-60.0, 0.0, 0.0))
    bar.scale = (1.2, 0.1, 1.0)
    mesh("plane", "panel", material("panel", "ShaderNodeEmission", Strength=25.0), (-0.9, -0.4, 1.2), 0.3, (0.0, -35.0, 0.0))
    view = camera((0.0, -1.9, 1.5), (0.0, 0.05, 0.05), lens=55.0)
    view.dof.use_dof, view.dof.focus_distance, view.dof.aperture_fstop = True, 2.35, 1.4


SCENES: dict[str, Callable[[], None]] = {
    "areas": areas,
    "point-and-spot": point_and_spot,
    "sun": sun,
    "emission": emission,
    "hdr": hdr,
    "glass": glass,
    "depth-of-field": depth_of_field,
    "orthographic": orthographic,
    "bench": bench,
}


def render_objects(file: str) -> list[str]:
    """Writes the number of the object of each pixel: an emitting material replaces all others. Gives the names from number 1."""
    scene = bpy.context.scene
    things = [thing for thing in scene.objects if thing.type == "MESH"]
    for number, thing in enumerate(things):
        thing.pass_index = number + 1
    shader = material("number", "ShaderNodeEmission")
    tree = shader.node_tree
    info = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(info.outputs["Object Index"], tree.nodes["Emission"].inputs["Strength"])
    tree.nodes["Emission"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    bpy.context.view_layer.material_override = shader
    scene.world, scene.camera.data.dof.use_dof = None, False
    scene.cycles.samples, scene.cycles.seed, scene.cycles.max_bounces = 1, 0, 0
    scene.render.filepath = file
    bpy.ops.render.render(write_still=True)
    return [thing.name for thing in things]


def main() -> int:
    """Builds, exports and renders a scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--batches", type=int, default=8)
    parser.add_argument("--threads", type=int, default=0)
    arguments = parser.parse_args()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    scene = reset()
    SCENES[arguments.scene]()
    bpy.context.view_layer.update()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    stem = arguments.folder.resolve() / arguments.scene
    notes = dunkelfeld_export.export(bpy.context, f"{stem}.toml", sensor="none", spp=arguments.spp)
    if arguments.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", arguments.threads
    scene.cycles.samples = arguments.spp
    for batch in range(arguments.batches):
        scene.cycles.seed = batch + 1
        scene.render.filepath = f"{stem}-{batch}.exr"
        bpy.ops.render.render(write_still=True)
    names = render_objects(f"{stem}-objects.exr")
    print(json.dumps({"version": bpy.app.version_string, "objects": names, "notes": notes}), file=answers, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
