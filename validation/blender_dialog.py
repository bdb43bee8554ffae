"""Opens the export dialog of the add-on in Blender with a window, for the picture of docs/blender.md.

    blender --python validation/blender_dialog.py

The add-on must be installed. The job would be written into the current folder. The scene is `bench` of `blender_scenes.py`,
with two lights, and with parts that a job cannot contain: a procedural texture, subsurface scattering, a light and an object
without shadows, motion blur.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import blender_scenes


def build() -> None:
    """The scene of the dialog."""
    scene = bpy.context.scene
    for thing in list(scene.objects):
        bpy.data.objects.remove(thing)
    blender_scenes.SCENES["bench"]()
    blender_scenes.lamp("AREA", "ring", (0.0, 0.0, 1.5), shape="DISK", size=0.3, energy=10.0)
    blender_scenes.lamp("SUN", "window", (0.0, 0.0, 3.0), (40.0, 0.0, 0.0), energy=0.5, use_shadow=False)
    plate = bpy.data.materials["plate"].node_tree
    noise = plate.nodes.new("ShaderNodeTexNoise")
    plate.links.new(noise.outputs["Color"], plate.nodes["Diffuse BSDF"].inputs["Color"])
    principled = bpy.data.materials["plastic"].node_tree.nodes["Principled BSDF"]
    principled.inputs["Subsurface Weight"].default_value = 0.2
    bpy.data.objects["ball 1"].visible_shadow = False
    scene.render.use_motion_blur = True


def dialog() -> None:
    """Opens the dialog in the first window."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.export_scene.dunkelfeld("INVOKE_DEFAULT", filepath=str(Path.cwd() / "station.toml"))


build()
bpy.app.timers.register(dialog, first_interval=2.0)
