"""Checks of the add-on with Blender: small scenes, whose files, notes and mean radiance are compared with those of Cycles.

    python blender_checks.py --dunkelfeld ../target/release/dunkelfeld

Needs the Python of `requirements-cycles.txt`. Without `--dunkelfeld`, only the files and notes are checked. The other arguments
are those of `unittest`.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path
from typing import Any

import blender_scenes as scenes
import bpy
import dunkelfeld_export as export
import numpy as np

PROGRAM: Path | None = None
SIZE = 32
SPP = 256
BAR = 0.015


def values(file: Path) -> np.ndarray:
    """The values of an image file, as they are in the file: (row, column, channel)."""
    image = bpy.data.images.load(str(file))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    found = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(found)
    bpy.data.images.remove(image)
    return found.reshape(height, width, 4)[..., :3].astype(np.float64)


def group(name: str) -> Any:
    """A tree of Geometry Nodes with a geometry at its input and its output."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    return tree


def through(tree: Any, kind: str, thing: Any) -> Any:
    """A modifier of the object with one node between input and output. Gives the node."""
    start, node, end = (tree.nodes.new(k) for k in ("NodeGroupInput", kind, "NodeGroupOutput"))
    tree.links.new(start.outputs[0], node.inputs["Geometry"])
    tree.links.new(node.outputs["Geometry"], end.inputs[0])
    thing.modifiers.new("nodes", "NODES").node_group = tree
    return node


def collection(name: str, *things: Any, linked: bool = True) -> Any:
    """A collection with these objects only, in the scene or for instances."""
    result = bpy.data.collections.new(name)
    if linked:
        bpy.context.scene.collection.children.link(result)
    for thing in things:
        for other in list(thing.users_collection):
            other.objects.unlink(thing)
        result.objects.link(thing)
    return result


def instance(name: str, what: Any, location: tuple = (0.0, 0.0, 0.0)) -> Any:
    """An empty that shows a collection."""
    empty = scenes.placed(None, name, location)
    empty.instance_type, empty.instance_collection = "COLLECTION", what
    return empty


def layer_collection(name: str) -> Any:
    """The collection in the view layer."""
    return bpy.context.view_layer.layer_collection.children[name]


class Scene(unittest.TestCase):
    """A scene with a floor, a camera above it and an even world."""

    def setUp(self) -> None:
        """The scene."""
        self.scene = scenes.reset()
        self.scene.render.resolution_x = self.scene.render.resolution_y = SIZE
        scenes.world((0.4, 0.4, 0.4))
        scenes.mesh("plane", "floor", scenes.diffuse("floor", 0.5, 0.5, 0.5), (0.0, 0.0, 0.0), 4.0)
        scenes.camera((0.0, -0.3, 1.2), (0.0, 0.0, 0.1), lens=45.0)
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.job_file = Path(folder.name) / "scene.toml"

    def export(self, **settings: Any) -> list[str]:
        """Exports; the scene and the number of data-blocks stay. The program accepts the job."""
        bpy.context.view_layer.update()
        before = self.state()
        notes: list[str] = export.export(bpy.context, str(self.job_file), **({"sensor": "none", "spp": SPP} | settings))
        self.assertEqual(self.state(), before)
        self.assertEqual(export.Survey(bpy.context).notes, notes)
        self.assertEqual(self.state(), before)
        data = self.job_file.with_suffix(".glb").read_bytes()
        (length,) = struct.unpack_from("<I", data, 12)
        self.file = json.loads(data[20 : 20 + length])
        self.job = tomllib.loads(self.job_file.read_text())
        if PROGRAM is not None:
            command = [str(PROGRAM), "inspect", str(self.job_file)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stderr)
        return notes

    def state(self) -> dict[str, Any]:
        """What an export changes for a while."""
        parts = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "scenes", "materials", "images")}
        layer = bpy.context.view_layer
        parts["scene"] = (bpy.context.window.scene.name, layer.name)
        parts["eyes"] = [thing.hide_get() for thing in layer.objects]
        parts["layers"] = [child.hide_viewport for child in layer.layer_collection.children]
        parts["hidden"] = [x.hide_viewport for x in (*bpy.data.objects, *bpy.data.collections)]
        parts["modifiers"] = [
            [getattr(m, name, None) for name in ("show_viewport", "levels")]
            for thing in bpy.data.objects
            for m in thing.modifiers
        ]
        parts["curves"] = [[c.resolution_u, *(s.resolution_u for s in c.splines)] for c in bpy.data.curves]
        parts["simplify"] = self.scene.render.simplify_subdivision
        nodes = [material.node_tree.nodes for material in bpy.data.materials if material.node_tree]
        parts["nodes"] = [sorted(node.name for node in tree) for tree in nodes]
        return parts

    def names(self) -> list[str]:
        """The names of the objects in the file, without camera and floor."""
        return sorted(n["name"] for n in self.file["nodes"] if "mesh" in n and n["name"] != "floor")

    def material(self, name: str) -> dict[str, Any]:
        """The material of this name in the file."""
        (found,) = [m for m in self.file.get("materials", []) if m["name"] == name]
        return found

    def color(self, name: str) -> list[float]:
        """The base colour of a material in the file, with three digits."""
        return [round(c, 3) for c in self.material(name)["pbrMetallicRoughness"]["baseColorFactor"][:3]]

    def vertices(self) -> list[int]:
        """The numbers of triangles of the meshes, without the floor."""
        meshes = [m for m in self.file["meshes"] if m["name"] != "floor"]
        return sorted(sum(self.file["accessors"][p["indices"]]["count"] // 3 for p in m["primitives"]) for m in meshes)

    def compare(self, bar: float = BAR) -> None:
        """The mean radiance of each channel and of each quarter of the image is that of Cycles."""
        if PROGRAM is None:
            return
        png, exr = self.job_file.with_suffix(".png"), self.job_file.with_name("cycles.exr")
        flags = ["--threads", "1", "--allocate", "uniform", "--progress", "none", "-o", str(png)]
        subprocess.run([str(PROGRAM), "render", str(self.job_file), *flags], check=True, capture_output=True)
        self.scene.cycles.samples = SPP
        self.scene.render.threads_mode, self.scene.render.threads = "FIXED", 1
        self.scene.render.filepath = str(exr)
        bpy.ops.render.render(write_still=True)
        ours, theirs = values(png) ** 2.2, values(exr)
        self.assertLess(theirs.max(), 0.9)
        half = SIZE // 2
        for rows in (slice(0, half), slice(half, SIZE)):
            for columns in (slice(0, half), slice(half, SIZE)):
                ratio = ours[rows, columns].mean(axis=(0, 1)) / theirs[rows, columns].mean(axis=(0, 1))
                self.assertLess(abs(ratio - 1.0).max(), bar, str(ratio))


class Materials(Scene):
    """Materials are found where a render finds them."""

    def test_materials_of_collection_instances(self) -> None:
        """A Diffuse BSDF and glass that only an instance shows."""
        red = scenes.mesh("cube", "red", scenes.diffuse("red", 0.8, 0.1, 0.1), (-0.15, 0.0, 0.101), 0.2)
        clear = scenes.material("clear", "ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.0)
        glass = scenes.mesh("cube", "glass", clear, (0.15, 0.0, 0.15), 0.2)
        instance("unit", collection("parts", red, glass, linked=False))
        self.assertEqual(self.export(), [])
        self.assertEqual(self.names(), ["unit/glass", "unit/red"])
        self.assertEqual(self.color("red"), [0.8, 0.1, 0.1])
        self.assertEqual(self.job["material"], [{"name": "clear", "solid": True}])
        bpy.data.objects.remove(glass)
        self.export()
        self.compare()

    def test_materials_of_geometry_nodes(self) -> None:
        """The node Set Material."""
        cube = scenes.mesh("cube", "cube", scenes.diffuse("blue", 0.1, 0.1, 0.8), (0.0, 0.0, 0.101), 0.2)
        node = through(group("set"), "GeometryNodeSetMaterial", cube)
        node.inputs["Material"].default_value = scenes.diffuse("red", 0.8, 0.1, 0.1)
        self.assertEqual(self.export(), [])
        self.assertEqual(self.color("red"), [0.8, 0.1, 0.1])
        self.compare()

    def test_materials_of_objects_and_faces(self) -> None:
        """Slots of an object, and two materials on one mesh; a slot without faces has no note."""
        cube = scenes.mesh("cube", "cube", scenes.diffuse("blue", 0.1, 0.1, 0.8), (-0.15, 0.0, 0.101), 0.2)
        other = scenes.placed(cube.data, "other", (0.15, 0.0, 0.101))
        other.material_slots[0].link = "OBJECT"
        other.material_slots[0].material = scenes.diffuse("red", 0.8, 0.1, 0.1)
        cube.data.materials.append(scenes.diffuse("green", 0.1, 0.8, 0.1))
        cube.data.materials.append(scenes.material("unused", "ShaderNodeBsdfHair"))
        cube.data.polygons[5].material_index = 1
        self.assertEqual(self.export(), [])
        self.assertEqual({self.color(name)[0] for name in ("red", "blue", "green")}, {0.8, 0.1})
        self.compare()

    def test_parts_of_another_file(self) -> None:
        """Materials, modifiers and visibility of a linked collection are those of a render, and restored."""
        red = scenes.diffuse("red", 0.8, 0.1, 0.1)
        bump = red.node_tree.nodes.new("ShaderNodeBump")
        red.node_tree.links.new(bump.outputs[0], red.node_tree.nodes["Diffuse BSDF"].inputs["Normal"])
        plastic = scenes.material("plastic", "ShaderNodeBsdfPrincipled", Base_Color=(0.1, 0.8, 0.1))
        bump = plastic.node_tree.nodes.new("ShaderNodeBump")
        plastic.node_tree.links.new(bump.outputs[0], plastic.node_tree.nodes["Principled BSDF"].inputs["Normal"])
        row = scenes.mesh("cube", "row", red, (-0.2, 0.0, 0.101), 0.1)
        row.modifiers.new("a", "ARRAY").show_viewport = False
        ball = scenes.mesh("sphere", "ball", plastic, (0.2, 0.0, 0.101), 0.2)
        collection("parts", row, ball, linked=False)
        file = str(self.job_file.with_name("parts.blend"))
        bpy.data.libraries.write(file, {bpy.data.collections["parts"]})
        self.setUp()
        with bpy.data.libraries.load(file, link=True) as (_, wanted):
            wanted.collections = ["parts"]
        instance("unit", bpy.data.collections["parts"])
        links = [len(bpy.data.materials[name].node_tree.links) for name in ("red", "plastic")]
        self.assertEqual(sum("Bump is left out" in note for note in self.export()), 2)
        self.assertEqual(links, [len(bpy.data.materials[name].node_tree.links) for name in ("red", "plastic")])
        self.assertEqual((self.names(), self.color("red")), (["unit/ball", "unit/row"], [0.8, 0.1, 0.1]))
        self.assertIn(24, self.vertices())
        self.compare()
        scenes.mesh("cube", "twin", scenes.diffuse("red", 0.1, 0.1, 0.8), (0.0, 0.3, 0.101), 0.1)
        self.assertEqual(sum("the same name" in note for note in self.export()), 2)

    def test_materials_without_nodes(self) -> None:
        """Diffuse of the colour of the viewport, as in Cycles; without an output node black."""
        plain = bpy.data.materials.new("plain")
        plain.use_nodes, plain.diffuse_color, plain.metallic = False, (0.1, 0.3, 0.8, 1.0), 1.0
        scenes.mesh("cube", "cube", plain, (-0.15, 0.0, 0.101), 0.2)
        empty = bpy.data.materials.new("empty")
        empty.use_nodes = True
        empty.node_tree.nodes.clear()
        scenes.mesh("cube", "other", empty, (0.15, 0.0, 0.101), 0.2)
        notes = self.export()
        self.assertEqual([note.split(":")[0] for note in notes], ["material plain", "material empty"])
        self.assertEqual((self.color("plain"), self.color("empty")), ([0.1, 0.3, 0.8], [0.0, 0.0, 0.0]))
        self.compare()

    def test_names_with_wildcards(self) -> None:
        """`A*` is renamed, so that the job does not change `AB` too."""
        glass = scenes.material("A*", "ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.0)
        scenes.mesh("cube", "cube", glass, (-0.15, 0.0, 0.15), 0.2)
        sheet = scenes.material("AB", "ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.0)
        scenes.mesh("plane", "sheet", sheet, (0.15, 0.0, 0.15), 0.2)
        notes = self.export()
        self.assertTrue(notes[0].startswith("material A*: it is named A_"), notes)
        self.assertEqual(self.job["material"], [{"name": "A_", "solid": True}])
        self.assertEqual({m["name"] for m in self.file["materials"]}, {"floor", "A_", "AB"})


class Visibility(Scene):
    """The file has the objects and lights of a render."""

    def part(self, name: str, x: float = 0.0) -> Any:
        """A red cube."""
        red = bpy.data.materials.get("red") or scenes.diffuse("red", 0.8, 0.1, 0.1)
        return scenes.mesh("cube", name, red, (x, 0.0, 0.101), 0.2)

    def test_hidden_in_the_render(self) -> None:
        """Objects and lights that are hidden themselves, or in a collection that is hidden, excluded, or in a hidden one."""
        for name in ("itself", "hidden", "excluded", "nested"):
            thing = self.part(name)
            light = scenes.lamp("POINT", f"light {name}", (0.2, 0.0, 0.5), energy=10.0)
            if name == "itself":
                thing.hide_render = light.hide_render = True
            else:
                collection(name, thing, light)
        bpy.data.collections["hidden"].hide_render = True
        layer_collection("excluded").exclude = True
        inner = bpy.data.collections["nested"]
        self.scene.collection.children.unlink(inner)
        bpy.data.collections["hidden"].children.link(inner)
        self.part("seen")
        self.assertEqual(self.export(), [])
        self.assertEqual((self.names(), self.job.get("light", [])), (["seen"], []))
        self.compare()

    def test_hidden_in_the_viewport(self) -> None:
        """All of them are rendered: hidden by the eye or the screen, themselves or with their collection."""
        for name, x in (("eye", -0.3), ("screen", -0.1), ("eyes", 0.1), ("screens", 0.3)):
            thing = self.part(name, x)
            light = scenes.lamp("SUN", f"light {name}", (0.0, 0.0, 1.0), energy=0.2)
            if name == "screen":
                thing.hide_viewport = light.hide_viewport = True
            if name in ("eyes", "screens"):
                collection(name, thing, light)
        for name in ("eye", "light eye"):
            bpy.data.objects[name].hide_set(True)
        layer_collection("eyes").hide_viewport = True
        bpy.data.collections["screens"].hide_viewport = True
        self.export()
        self.assertEqual(self.names(), ["eye", "eyes", "screen", "screens"])
        self.assertEqual(len(self.job["light"]), 4)
        self.compare()

    def test_hidden_parts_of_instances(self) -> None:
        """Hidden objects in an instanced collection, hidden instances, and hidden sources of Geometry Nodes."""
        hidden = self.part("hidden part")
        hidden.hide_render = True
        parts = collection("parts", self.part("part", 0.2), hidden, linked=False)
        instance("unit", parts)
        instance("hidden unit", parts, (0.0, 0.3, 0.0)).hide_render = True
        source = self.part("source")
        source.location, source.hide_render = (0.0, 0.0, 0.0), True
        carrier = scenes.mesh("plane", "carrier", bpy.data.materials["floor"], (-0.2, 0.0, 0.101), 0.1)
        tree = group("copies")
        node, end = (tree.nodes.new(k) for k in ("GeometryNodeObjectInfo", "NodeGroupOutput"))
        node.inputs["Object"].default_value, node.inputs["As Instance"].default_value = source, True
        tree.links.new(node.outputs["Geometry"], end.inputs[0])
        carrier.modifiers.new("nodes", "NODES").node_group = tree
        self.export()
        self.assertEqual(self.names(), ["carrier/source", "unit/part"])
        self.compare()

    def test_a_child_of_a_hidden_parent(self) -> None:
        """It is rendered at its place, also with shear and a mirror image."""
        parent = self.part("parent")
        parent.hide_render, parent.scale, parent.rotation_euler = True, (1.5, 0.6, -1.0), (0.2, 0.1, 0.4)
        child = self.part("child")
        child.parent, child.rotation_euler = parent, (0.3, 0.5, 0.6)
        self.assertEqual(self.export(), [])
        self.assertEqual(self.names(), ["child"])
        self.compare()

    def test_particles_of_objects(self) -> None:
        """They are instances; hair is listed."""
        emitter = scenes.mesh("plane", "emitter", bpy.data.materials["floor"], (0.0, 0.0, 0.05), 0.6)
        for name in ("parts", "hair"):
            settings = emitter.modifiers.new(name, "PARTICLE_SYSTEM").particle_system.settings
            settings.type, settings.count = "HAIR", 3
        part = self.part("part", 2.0)
        part.hide_render = True
        settings = emitter.particle_systems[0].settings
        settings.render_type, settings.instance_object, settings.display_percentage = "OBJECT", part, 0
        notes = self.export()
        self.assertEqual(self.names(), ["emitter", "emitter/part", "emitter/part#2", "emitter/part#3"])
        self.assertEqual(len(notes), 1)
        self.assertIn("hair", notes[0])

    def test_copies_at_vertices(self) -> None:
        """The object itself and the instancer are hidden, the copies are not; so is a light."""
        instancer = scenes.mesh("plane", "instancer", bpy.data.materials["floor"], (0.0, 0.0, 0.01), 0.6)
        instancer.instance_type, instancer.show_instancer_for_render = "VERTS", False
        lamp = scenes.lamp("POINT", "lamp", (0.0, 0.0, 0.5), energy=0.5, shadow_soft_size=0.0)
        for thing in (self.part("part"), lamp):
            thing.parent = instancer
        self.export()
        names = ["instancer/part", *(f"instancer/part#{k}" for k in (2, 3, 4))]
        self.assertEqual(self.names(), names)
        self.assertEqual([light["name"] for light in self.job["light"]], [n.replace("part", "lamp") for n in names])
        self.compare()

    def test_a_camera_of_another_scene(self) -> None:
        """The scene `main` shows another scene behind its own objects, and has its camera."""
        self.part("part")
        settings = self.scene
        self.scene = bpy.data.scenes.new("main")
        bpy.context.window.scene = self.scene
        self.scene.background_set, self.scene.camera, self.scene.world = settings, settings.camera, settings.world
        self.scene.render.resolution_x = self.scene.render.resolution_y = SIZE
        self.scene.render.engine = "CYCLES"
        for name in ("file_format", "color_mode", "color_depth"):
            setattr(self.scene.render.image_settings, name, getattr(settings.render.image_settings, name))
        self.assertEqual(self.export(), [])
        self.assertEqual(self.names(), ["part"])
        self.compare()

    def test_a_sheared_camera(self) -> None:
        """A note; without shear, scale has no effect."""
        parent = scenes.placed(None, "parent", (0.0, 0.0, 0.0))
        parent.scale, parent.rotation_euler = (2.0, 2.0, 2.0), (0.1, 0.0, 0.2)
        self.scene.camera.parent, self.scene.camera.location = parent, (0.0, -0.1, 0.6)
        self.part("part")
        self.assertEqual(self.export(), [])
        self.compare()
        parent.scale = (1.0, 2.0, 1.5)
        notes = self.export()
        self.assertEqual((len(notes), "shear" in notes[0]), (1, True))

    def test_an_active_camera_that_is_hidden(self) -> None:
        """It is the camera of the render."""
        self.scene.camera.hide_render = self.scene.camera.hide_viewport = True
        self.export()
        self.assertIn("camera", [n["name"] for n in self.file["nodes"]])
        self.compare()


class Levels(Scene):
    """Meshes are those of the render."""

    def test_levels_of_the_render(self) -> None:
        """Subdivision, a modifier that the viewport does not show, and one that the render does not show."""
        red = scenes.diffuse("red", 0.8, 0.1, 0.1)
        ball = scenes.mesh("cube", "ball", red, (-0.2, 0.0, 0.2), 0.3).modifiers.new("s", "SUBSURF")
        ball.levels, ball.render_levels = 0, 3
        row = scenes.mesh("cube", "row", red, (0.1, 0.0, 0.101), 0.1).modifiers.new("a", "ARRAY")
        row.count, row.show_viewport = 3, False
        single = scenes.mesh("cube", "single", red, (0.0, 0.3, 0.101), 0.1).modifiers.new("a", "ARRAY")
        single.count, single.show_render = 5, False
        self.assertEqual(self.export(), [])
        self.assertEqual(self.vertices(), [12, 36, 768])
        self.assertEqual(sorted(m["name"] for m in self.file["meshes"]), ["ball", "floor", "row", "single"])
        self.compare()
        render = self.scene.render
        render.use_simplify, render.simplify_subdivision, render.simplify_subdivision_render = True, 0, 1
        self.export()
        self.assertEqual(self.vertices(), [12, 36, 48])

    def test_curves_texts_and_metaballs(self) -> None:
        """They have the resolution of the render and their materials."""
        red, green = scenes.diffuse("red", 0.8, 0.1, 0.1), scenes.diffuse("green", 0.1, 0.8, 0.1)
        curve = bpy.data.curves.new("curve", "CURVE")
        curve.dimensions, curve.bevel_depth, curve.resolution_u, curve.render_resolution_u = "3D", 0.05, 2, 20
        spline = curve.splines.new("BEZIER")
        spline.bezier_points.add(1)
        for x, point in zip((-0.3, 0.3), spline.bezier_points):
            point.co, point.handle_left, point.handle_right = (x, 0.2, 0.1), (x, 0.1, 0.1), (x, 0.4, 0.1)
        text = bpy.data.curves.new("text", "FONT")
        text.body, text.size, text.extrude = "Dk", 0.3, 0.02
        for data, material, place in ((curve, red, (0.0, 0.0, 0.0)), (text, green, (-0.1, -0.2, 0.05))):
            data.materials.append(material)
            scenes.placed(data, data.name, place)
        ball = bpy.data.metaballs.new("ball")
        ball.elements.new().radius = 0.2
        ball.resolution, ball.render_resolution = 0.3, 0.04
        ball.materials.append(red)
        scenes.placed(ball, "ball", (0.3, -0.1, 0.2))
        self.assertEqual(self.export(), [])
        self.assertEqual(self.names(), ["ball", "curve", "text"])
        self.compare()

    def test_is_viewport(self) -> None:
        """A node that a render answers in another way is listed."""
        cube = scenes.mesh("cube", "cube", bpy.data.materials["floor"], (0.0, 0.0, 0.101), 0.1)
        node = through(group("view"), "GeometryNodeSetShadeSmooth", cube)
        tree = cube.modifiers[0].node_group
        tree.links.new(tree.nodes.new("GeometryNodeIsViewport").outputs[0], node.inputs["Shade Smooth"])
        notes = self.export()
        self.assertEqual((len(notes), "Is Viewport" in notes[0]), (1, True))


class World(Scene):
    """Images of the world."""

    def image(self, space: str) -> None:
        """A world with an image of 8 bits in this colour space."""
        height, width = 32, 64
        rows, columns = np.mgrid[0:height, 0:width]
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., 0], pixels[..., 1], pixels[..., 2] = columns / width, 0.3, rows / height
        made = bpy.data.images.new("sky", width, height)
        made.pixels.foreach_set(pixels.ravel())
        file = self.job_file.with_name("sky.png")
        made.filepath_raw, made.file_format = str(file), "PNG"
        made.save()
        nodes = self.scene.world.node_tree.nodes
        texture = nodes.new("ShaderNodeTexEnvironment")
        texture.image = bpy.data.images.load(str(file))
        texture.image.colorspace_settings.name = space
        self.scene.world.node_tree.links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])

    def test_an_image_of_8_bits(self) -> None:
        """Its values are decoded."""
        self.image("sRGB")
        self.assertEqual(self.export(), [])
        self.compare()

    def test_an_image_of_8_bits_without_a_space(self) -> None:
        """Its values stay."""
        self.image("Non-Color")
        self.assertEqual(self.export(), [])
        self.compare()

    def test_a_negative_world(self) -> None:
        """It becomes 0."""
        self.scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = -1.0
        scenes.lamp("SUN", "sun", (0.0, 0.0, 1.0), energy=1.0, angle=0.0)
        notes = self.export()
        self.assertEqual((len(notes), "negative" in notes[0]), (1, True))
        self.assertEqual(self.job["environment"]["radiance"], [0.0] * 3)


class Refused(Scene):
    """What the program refuses is not written."""

    def test_lights(self) -> None:
        """Negative energy, spreads below a degree."""
        scenes.lamp("POINT", "negative", (0.2, 0.0, 0.5), energy=-2.0)
        for degrees in (0.0, 0.5):
            lamp = scenes.lamp("AREA", f"spread {degrees}", (0.0, 0.0, 0.5), energy=1.0, size=0.3)
            lamp.data.spread = math.radians(degrees)
        notes = self.export()
        self.assertEqual(sum("1 degree is used" in note for note in notes), 2)
        self.assertEqual([light["name"] for light in self.job["light"]], ["spread 0.0", "spread 0.5"])
        self.assertEqual(sum(note.startswith("light negative:") for note in notes), 2)

    def test_settings(self) -> None:
        """Errors have the name of the setting, and no file is written."""
        for key, value in (("sensor", "bogus"), ("exposure", "x y"), ("time", "-3s"), ("spp", -5)):
            settings = {"sensor": "imx250", "spp": 0} | {key: value}
            with self.assertRaisesRegex(ValueError, f"^{key} "):
                export.export(bpy.context, str(self.job_file), **settings)
        self.assertEqual(list(self.job_file.parent.iterdir()), [])


class Notes(Scene):
    """Parts that a job cannot contain are listed."""

    def test_visibility(self) -> None:
        """Rays, holdouts, light linking, collections of the view layer, also of instances."""
        red = scenes.diffuse("red", 0.8, 0.1, 0.1)
        for name in ("camera", "catcher", "holdout", "linked", "cut"):
            scenes.mesh("cube", name, red, (0.0, 0.0, 0.5), 0.1)
        things = bpy.data.objects
        things["camera"].name = "invisible"
        things["invisible"].visible_camera, things["catcher"].is_shadow_catcher = False, True
        things["holdout"].is_holdout = True
        things["linked"].light_linking.receiver_collection = bpy.data.collections.new("receivers")
        collection("cut", things["cut"])
        layer_collection("cut").holdout = True
        part = scenes.mesh("cube", "part", red, (0.0, 0.0, 0.5), 0.1)
        instance("unit", collection("parts", part, linked=False)).visible_shadow = False
        subjects = {note.split(":")[0] for note in self.export()}
        expected = {f"object {name}" for name in ("invisible", "catcher", "holdout", "linked", "unit")}
        self.assertEqual(subjects, expected | {"collection cut"})

    def test_rays_of_lights_and_of_the_world(self) -> None:
        """Lights that some rays miss, and a world that the camera does not see."""
        scenes.lamp("SUN", "sun", (0.0, 0.0, 1.0), energy=0.2, angle=0.0).visible_diffuse = False
        self.scene.world.cycles_visibility.camera = False
        self.assertEqual([note.split(":")[0] for note in self.export()], ["light sun", "world"])

    def test_clip_distances(self) -> None:
        """Objects in view that they cut, and no others."""
        bpy.data.objects["floor"].scale = (0.4, 0.4, 1.0)
        scenes.mesh("cube", "cut", bpy.data.materials["floor"], (0.0, 0.0, 0.15), 0.3)
        scenes.mesh("cube", "aside", bpy.data.materials["floor"], (2.0, 0.0, 0.3), 0.3)
        scenes.mesh("cube", "low", bpy.data.materials["floor"], (0.2, 0.0, 0.03), 0.05)
        self.assertEqual(self.export(), [])
        self.scene.camera.data.clip_start = 0.95
        notes = self.export()
        self.assertEqual((len(notes), "which cut cut, are" in notes[0]), (1, True), notes)

    def test_attributes(self) -> None:
        """A number at each vertex is no colour; colours are carried."""
        for name, kind in (("heat", "FLOAT"), ("paint", "FLOAT_COLOR")):
            material = scenes.diffuse(name, 0.5, 0.5, 0.5)
            thing = scenes.mesh("cube", name, material, (0.0, 0.0, 0.15), 0.2)
            thing.data.attributes.new(name, kind, "POINT")
            node = material.node_tree.nodes.new("ShaderNodeAttribute")
            node.attribute_name = name
            material.node_tree.links.new(
                node.outputs["Color"], material.node_tree.nodes["Diffuse BSDF"].inputs["Color"]
            )
        notes = self.export()
        self.assertEqual((len(notes), "attribute heat" in notes[0]), (1, True), notes)

    def test_uv_maps(self) -> None:
        """Textures on a mesh without a UV map, and of a UV map that is missing."""
        image = bpy.data.images.new("image", 4, 4)
        for name, maps, wanted in (("bare", (), ""), ("other", ("first",), "second"), ("good", ("first",), "first")):
            material = scenes.diffuse(name, 0.5, 0.5, 0.5)
            nodes, links = material.node_tree.nodes, material.node_tree.links
            thing = scenes.mesh("plane", name, material, (0.0, 0.0, 0.1), 0.2)
            for layer in maps:
                thing.data.uv_layers.new(name=layer)
            texture, way = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeUVMap")
            texture.image, way.uv_map = image, wanted
            links.new(way.outputs[0], texture.inputs["Vector"])
            links.new(texture.outputs["Color"], nodes["Diffuse BSDF"].inputs["Color"])
        notes = self.export()
        self.assertEqual([note.split(":")[0] for note in notes], ["material bare", "material other"], notes)

    def test_kinds_of_objects(self) -> None:
        """Hair curves and a volume in the world."""
        hair = bpy.data.hair_curves.new("hair")
        hair.add_curves([3])
        scenes.placed(hair, "hair", (0.0, 0.0, 0.0))
        tree = self.scene.world.node_tree
        volume = tree.nodes.new("ShaderNodeVolumeScatter")
        tree.links.new(volume.outputs[0], tree.nodes["World Output"].inputs["Volume"])
        notes = self.export()
        self.assertEqual([note.split(":")[0] for note in notes], ["object hair", "world"])


def main() -> None:
    """Runs the checks."""
    global PROGRAM
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, help="our renderer")
    arguments, others = parser.parse_known_args()
    PROGRAM = arguments.dunkelfeld.resolve() if arguments.dunkelfeld else None
    unittest.main(argv=[sys.argv[0], *others])


if __name__ == "__main__":
    main()
