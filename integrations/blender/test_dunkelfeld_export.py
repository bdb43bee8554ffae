"""Tests of the add-on that need no Blender: `python -m unittest discover integrations/blender`.

`example.toml` is the job of the lights below. `python test_dunkelfeld_export.py --write` writes it again.
"""

import json
import math
import re
import struct
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path
from types import SimpleNamespace

import dunkelfeld_export as export

EXAMPLE = Path(__file__).with_name("example.toml")
NOTES = ['light hall: its "nodes" are not an Emission;\nthe light is used without its nodes']


def light(kind, **settings):
    """A light as Blender describes it."""
    values = {
        "type": kind,
        "color": (1.0, 0.5, 0.25),
        "energy": 8.0,
        "use_nodes": False,
        "node_tree": None,
        "normalize": True,
    }
    values |= {"exposure": 0.0, "use_temperature": False, "shadow_soft_size": 0.0, "spot_size": 1.0, "spot_blend": 0.2}
    values |= {"shape": "SQUARE", "size": 0.1, "size_y": 0.2, "spread": math.pi, "angle": 0.1}
    return SimpleNamespace(**(values | settings))


def matrix(x=(1, 0, 0), y=(0, 1, 0), z=(0, 0, 1), position=(0.1, 0.2, 0.3)):
    """A matrix to the world from its columns."""
    return [[x[k], y[k], z[k], position[k]] for k in range(3)] + [[0, 0, 0, 1]]


def tables():
    """Tables of all kinds of lights."""
    lights = {
        "square": light("AREA"),
        "rectangle": light("AREA", shape="RECTANGLE", spread=math.radians(90.0)),
        "disc": light("AREA", shape="DISK"),
        "ellipse": light("AREA", shape="ELLIPSE"),
        "point": light("POINT", shadow_soft_size=0.05),
        "small point": light("POINT"),
        "spot": light("SPOT", shadow_soft_size=0.05),
        "sun": light("SUN"),
    }
    return {name: export.light_table(name, data, matrix(), []) for name, data in lights.items()}


def example():
    """The text of `example.toml`."""
    top = {"scene": "none", "seed": 7}
    shared = [("import", {"emissive_unit": "W/(m2 sr)"}), ("film", {"width": 64, "height": 48}), ("lens", {})]
    shared += [("budget", {"spp": 16}), ("sensor", {"model": "imx250", "exposure": "1ms"})]
    shared += [("environment", {"radiance": [0.1, 0.2, 0.3]})]
    return export.job_text(top, shared + [("[light]", table) for table in tables().values()], NOTES)


class Job(unittest.TestCase):
    """The text of jobs."""

    def test_the_example_is_up_to_date(self):
        """The fixture is the text of today's writer."""
        self.assertEqual(example(), EXAMPLE.read_text())

    def test_any_name_can_be_read_back(self):
        """Quotes, control characters and empty texts survive; a line break in a note stays in the comment."""
        name = 'a "b" \\ \n\t\x01\x7f é'
        text = export.job_text({"scene": name, "seed": 3}, [("[material]", {"name": "", "solid": True})], ["a\nb = 1"])
        self.assertEqual(tomllib.loads(text), {"scene": name, "seed": 3, "material": [{"name": "", "solid": True}]})

    def test_numbers_keep_their_type_and_single_precision(self):
        """A float stays a float; NaN is refused."""
        values = {"a": 1.0, "b": 1e-9, "c": -0.0, "d": [1.0 / 3.0, 2], "e": 1e22}
        found = tomllib.loads(export.job_text({}, [("t", values)], []))["t"]
        self.assertEqual([type(found[key]) for key in "abc"], [float] * 3)
        self.assertAlmostEqual(found["d"][0], 1.0 / 3.0, delta=1e-7)
        self.assertEqual(found["e"], 1e22)
        with self.assertRaises(ValueError):
            export.value_text(math.nan)


class Lights(unittest.TestCase):
    """Strengths against the power of the light, by integrals over the emitter and the directions."""

    def test_powers(self):
        """Lambertian panels: pi A L. Points: 4 pi I."""
        found = tables()
        areas = {"square": 0.01, "disc": math.pi * 0.0025, "ellipse": math.pi * 0.005}
        for name, area in areas.items():
            self.assertAlmostEqual(math.pi * area * found[name]["radiance"][0], 8.0, places=9)
        for name in ("point", "small point", "spot"):
            self.assertAlmostEqual(4.0 * math.pi * found[name]["intensity"][0], 8.0, places=9)
        self.assertEqual(found["sun"]["irradiance"], [8.0, 4.0, 2.0])

    def test_a_spread_keeps_the_power(self):
        """The integral of (1 - tan t / tan h) cos t over the directions, by the midpoint rule."""
        for full in (0.2, 1.0, 2.0, 3.0):
            h, n = 0.5 * full, 20000
            angles = [(k + 0.5) * h / n for k in range(n)]
            sums = sum((1.0 - math.tan(t) / math.tan(h)) * math.cos(t) * math.sin(t) for t in angles)
            self.assertAlmostEqual(export.spread_gain(full) * 2.0 * sums * h / n, 1.0, places=5)
        self.assertEqual(export.spread_gain(math.pi), 1.0)

    def test_axes_and_scale(self):
        """Blender's +z is +y; a light of Blender shines along its -z; scale enlarges an area light and keeps its power."""
        turned = matrix(x=(0, 2, 0), y=(0, 0, 3), z=(1, 0, 0))
        table = export.light_table("a", light("AREA", shape="RECTANGLE"), turned, [])
        self.assertEqual(table["position"], [0.1, 0.3, -0.2])
        self.assertEqual([x + 0.0 for x in table["aim"]], [-1.0, 0.0, 0.0])
        self.assertEqual([x + 0.0 for x in table["up"]], [0.0, 1.0, 0.0])
        self.assertAlmostEqual(table["width"], 0.2)
        self.assertAlmostEqual(table["height"], 0.6)
        self.assertAlmostEqual(math.pi * 0.12 * table["radiance"][0], 8.0)

    def test_lights_that_are_not_normalized(self):
        """The energy is a power per area, for points of the sphere, for the sun of the sine of its half-angle."""
        area = export.light_table("a", light("AREA", normalize=False), matrix(), [])
        self.assertAlmostEqual(math.pi * area["radiance"][0], 8.0)
        point = export.light_table("a", light("POINT", normalize=False, shadow_soft_size=0.1), matrix(), [])
        self.assertAlmostEqual(point["intensity"][0], 8.0 * 0.01)
        sun = export.light_table("a", light("SUN", normalize=False), matrix(), [])
        self.assertAlmostEqual(sun["irradiance"][0], 8.0 * math.pi * math.sin(0.05) ** 2)

    def test_lights_with_an_extent(self):
        """A point without a radius and a sun without an angle are invisible."""
        found = [name for name, table in tables().items() if not export.has_extent(table)]
        self.assertEqual(found, ["small point"])
        self.assertFalse(export.has_extent(export.light_table("a", light("SUN", angle=0.0), matrix(), [])))

    def test_a_spread_below_one_degree(self):
        """It becomes one degree, with the same power and a note."""
        one = export.light_table("a", light("AREA", spread=math.radians(1.0)), matrix(), [])
        for spread in (0.0, math.radians(0.5)):
            notes = []
            table = export.light_table("a", light("AREA", spread=spread), matrix(), notes)
            self.assertEqual(table, one)
            self.assertIn("spread", notes[0])

    def test_strengths_and_sizes_that_a_job_refuses(self):
        """A light of negative energy is left out, a negative channel becomes 0, others become the nearest values."""
        for kind in ("AREA", "POINT", "SPOT", "SUN"):
            notes = []
            self.assertEqual(export.light_table("a", light(kind, energy=-2.0), matrix(), notes), {})
            self.assertIn("negative", notes[0])
            self.assertIn("left out", notes[1])
        key = {"AREA": "radiance", "POINT": "intensity", "SPOT": "intensity", "SUN": "irradiance"}
        for kind, name in key.items():
            notes = []
            table = export.light_table("a", light(kind, color=(1.0, -0.5, 0.25)), matrix(), notes)
            self.assertEqual((table[name][1], len(notes)), (0.0, 1))
            self.assertGreater(table[name][0], table[name][2])
            notes = []
            table = export.light_table("a", light(kind, energy=1e15, color=(1.0, 1.0, 1.0)), matrix(), notes)
            self.assertEqual(table[name], [1e12] * 3)
            self.assertTrue(notes)
        notes = []
        table = export.light_table("a", light("POINT", shadow_soft_size=600.0), matrix(), notes)
        self.assertEqual((table["diameter"], len(notes)), (1000.0, 1))
        table = export.light_table("a", light("AREA", size=2000.0), matrix(), notes)
        self.assertEqual((table["width"], table["height"], len(notes)), (1000.0, 1000.0, 3))

    def test_a_light_without_extent_in_one_axis_is_left_out(self):
        """A scale of 0 gives no division by zero, but a note."""
        notes = []
        self.assertEqual(export.light_table("a", light("AREA"), matrix(x=(0, 0, 0)), notes), {})
        self.assertEqual(notes, ["its scale is 0"])


class Conversions(unittest.TestCase):
    """Lens and materials."""

    def test_the_aperture_of_a_lens(self):
        """A thin lens of 1 / f = 1 / u + 1 / v; a polygon of the area of the circle has larger corners."""
        focal = 1.0 / (1.0 / 2.0 + 1.0 / 0.05)
        self.assertAlmostEqual(export.f_number(0.01, 2.0, 0.05, 0), focal / 0.02)
        corner = math.sqrt(2.0 * math.pi / (6.0 * math.sin(math.pi / 3.0)))
        self.assertAlmostEqual(export.f_number(0.01, 2.0, 0.05, 6), focal / 0.02 * corner)

    def test_base_colors_of_a_glb(self):
        """The JSON changes, the binary chunk stays, emitters become double-sided, bare meshes get a material."""
        document = {"materials": [{"name": "a", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.4, 0.2, 0.9]}}]}
        document["materials"] += [{"name": "b", "emissiveFactor": [0, 1, 0]}]
        document["meshes"] = [{"primitives": [{"material": 0}, {}]}, {"primitives": [{}]}]
        text, rest = json.dumps(document).encode(), b"\x04\x00\x00\x00BIN\x00abcd"
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.glb"
            path.write_bytes(head + text + rest)
            export.change_glb(str(path), lambda document: export.change_materials(document, {}, {}))
            data = path.read_bytes()
        (length,) = struct.unpack_from("<I", data, 12)
        self.assertEqual(struct.unpack_from("<I", data, 8)[0], len(data))
        self.assertEqual((len(data) % 4, data[20 + length :]), (0, rest))
        found = json.loads(data[20 : 20 + length])
        first, second, third = found["materials"]
        self.assertEqual([p["material"] for mesh in found["meshes"] for p in mesh["primitives"]], [0, 2, 2])
        self.assertEqual(third["pbrMetallicRoughness"]["baseColorFactor"], [0.8, 0.8, 0.8, 1.0])
        self.assertEqual(first["pbrMetallicRoughness"]["baseColorFactor"], [0.5, 0.4, 0.2, 0.9])
        self.assertTrue(second["doubleSided"])

    def test_materials_without_nodes(self):
        """They are diffuse, whatever Blender's exporter wrote, and renamed."""
        document = {"materials": [{"name": "a*", "doubleSided": True, "emissiveFactor": [1, 1, 1]}, {"name": "b"}]}
        export.change_materials(document, {"a*": [0.1, 0.3, 1.5]}, {"a*": "a_"})
        first, second = document["materials"]
        self.assertEqual(first["pbrMetallicRoughness"]["baseColorFactor"], [0.1, 0.3, 1.0, 1.0])
        self.assertEqual(first["extensions"], {"KHR_materials_specular": {"specularFactor": 0.0}})
        self.assertEqual((first["name"], first["doubleSided"], "emissiveFactor" in first), ("a_", True, False))
        self.assertEqual(second, {"name": "b"})
        self.assertEqual(document["extensionsUsed"], ["KHR_materials_specular"])

    def test_names_are_no_patterns(self):
        """Wildcards are replaced, and all names stay different."""
        found = export.job_names(["A*", "AB", "A?", "A_", "plain"])
        self.assertEqual(found, {"A*": "A__", "A?": "A___"})

    def test_names_of_instances(self):
        """The second instance has a number, also beside an object with this name."""
        names = export.Names()
        found = [names.unique(name) for name in ("a", "a#2", "a", "a", "b", "a#2")]
        self.assertEqual(found, ["a", "a#2", "a#3", "a#4", "b", "a#2#2"])

    def test_srgb_of_8_bits(self):
        """Ends, the linear part, and the middle grey of 18 %."""
        table = export.srgb_table()
        self.assertEqual((len(table), table[0], table[255]), (256, 0.0, 1.0))
        self.assertAlmostEqual(table[10], 10.0 / 255.0 / 12.92)
        self.assertAlmostEqual(table[118], 0.18116424424986022)

    def test_settings_that_a_job_refuses(self):
        """The error has the name of the setting."""
        good = {"sensor": "imx250", "exposure": "5ms", "time": "30s", "spp": 0}
        for change in ({}, {"sensor": "my.toml"}, {"sensor": "none", "exposure": "x"}, {"spp": 1, "time": "x"}):
            export.check_settings(**(good | change))
        bad = {"sensor": ("bogus", ""), "exposure": ("x y", "0s", "1000h"), "time": ("-3s", "auto", "9000h")}
        bad |= {"spp": (-5, 2_000_000_000)}
        for key, values in bad.items():
            for value in values:
                with self.assertRaisesRegex(ValueError, f"^{key} "):
                    export.check_settings(**(good | {key: value}))

    def test_times_of_a_job(self):
        """Numbers with units, several of them, or one number of seconds; nothing else, and nothing of length 0."""
        for text in ("5ms", "1min 30s", "1min30s", "5 ms", "1e-3s", "0.5h", ".5s", "30", " 2us "):
            self.assertTrue(export.is_time(text), text)
        for text in ("", "auto", "5m", "5MS", "1min 30", "0s", "-5ms", "nan", "5ms x", "s", "1e"):
            self.assertFalse(export.is_time(text), text)

    def test_lines_of_the_dialog(self):
        """Words stay whole if they fit, all characters remain, and no line is wider than the panel."""
        text = "material a_very_long_name_of_a_part: Base Color is left out"
        for width in (1, 7, 12, 80):
            lines = export.wrapped(text, width, len)
            self.assertLessEqual(max(map(len, lines)), width)
            self.assertEqual("".join(lines).replace(" ", ""), text.replace(" ", ""))
        self.assertEqual(export.wrapped("Base Color is left out", 10, len), ["Base Color", "is left", "out"])
        self.assertEqual(export.wrapped("", 10, len), [""])

    def test_proposed_sensors_are_the_presets(self):
        """The list of the dialog is that of the program."""
        presets = Path(__file__).resolve().parents[2] / "crates" / "camera" / "sensor" / "src" / "presets.rs"
        self.assertEqual(list(export.SENSORS), re.findall(r'\("([^"]+)", include_str', presets.read_text()))


def socket(name="", node=None, value=0.5, output="Color"):
    """An input of a node, with a link from a node or a value."""
    links = [SimpleNamespace(from_node=node, from_socket=SimpleNamespace(name=output))] if node else []
    return SimpleNamespace(name=name, is_linked=bool(node), links=links, default_value=value)


def node(kind, label, inputs=(), **settings):
    """A node of a material."""
    return SimpleNamespace(bl_idname=f"ShaderNode{kind}", bl_label=label, name=label, inputs=Inputs(inputs), **settings)


class Inputs(list):
    """The inputs of a node, by number or name."""

    def __getitem__(self, key):
        return next(i for i in self if i.name == key) if isinstance(key, str) else super().__getitem__(key)

    def __contains__(self, key):
        return any(i.name == key for i in self)


class Textures(unittest.TestCase):
    """Nodes that glTF does not have are in the list."""

    def notes(self, end, name="Base Color"):
        """The notes on a texture of an input."""
        found = []
        export.texture_notes(name, socket(name, end), found)
        return found

    def image(self, way=None, output="UV", projection="FLAT"):
        """An image texture with coordinates."""
        return node("TexImage", "Image Texture", [socket("Vector", way, output=output)], projection=projection)

    def test_images_are_carried(self):
        """Alone, with texture coordinates, and times a constant."""
        uv = self.image(node("TexCoord", "Texture Coordinate"))
        mapped = self.image(
            node("Mapping", "Mapping", [socket("Vector", node("TexCoord", "Texture Coordinate"), output="UV")])
        )
        inputs = [socket("Factor", value=1.0), socket("A", self.image()), socket("B", value=(0.5, 0.5, 0.5, 1.0))]
        product = node("Mix", "Mix", inputs, blend_type="MULTIPLY")
        for end in (self.image(), uv, mapped, product):
            self.assertEqual(self.notes(end), [])
        half = node("Math", "Math", [socket("Value", self.image()), socket("Value")], operation="MULTIPLY")
        self.assertEqual(self.notes(half, "Roughness"), [])

    def test_images_in_another_colour_space(self):
        """Colours are sRGB in a file of glTF, all else linear; borders and values of objects are listed too."""
        for space, name, count in (
            ("sRGB", "Base Color", 0),
            ("Non-Color", "Base Color", 1),
            ("sRGB", "Roughness", 1),
            ("Non-Color", "Roughness", 0),
            ("sRGB", "Alpha", 0),
        ):
            end = self.image()
            end.image = SimpleNamespace(is_float=False, colorspace_settings=SimpleNamespace(name=space))
            self.assertEqual(len(self.notes(end, name)), count, (space, name))
        end = self.image()
        end.image = None
        self.assertIn("missing", self.notes(end)[0])
        end = self.image()
        end.extension = "CLIP"
        self.assertIn("border", self.notes(end)[0])
        self.assertIn("object", self.notes(node("Attribute", "Attribute", attribute_type="OBJECT"))[0])
        self.assertEqual(self.notes(node("Attribute", "Attribute", attribute_type="GEOMETRY")), [])

    def test_mappings(self):
        """A turn about z is carried; a tilt, a second mapping and a texture as its scale are listed."""

        def mapping(turn=(0.0, 0.0, 0.5), scale=None, before=None):
            values = [socket("Vector", before), socket("Rotation", value=turn)]
            return node("Mapping", "Mapping", [*values, socket("Scale", scale, value=(1.0, 1.0, 1.0))])

        self.assertEqual(self.notes(self.image(mapping())), [])
        for way in (mapping((0.5, 0.0, 0.0)), mapping(scale=self.image()), mapping(before=mapping())):
            self.assertIn("Mapping", self.notes(self.image(way))[0])

    def test_constants_out_of_range(self):
        """Colours above 1 or below 0, negative emission, and an index below 1."""
        for inputs, text in (
            ({"Base Color": [1.5, 0.2, 0.1]}, "1.5"),
            ({"Base Color": [-0.5, 0.2, 0.1]}, "negative base"),
            ({"Emission Color": [0.5, 0.2, 0.1], "Emission Strength": -1.0}, "emission"),
            ({"Transmission Weight": 1.0, "IOR": 0.8}, "0.8"),
        ):
            notes = []
            export.range_notes(inputs.get, notes)
            self.assertEqual((len(notes), text in notes[0]), (1, True))
        notes = []
        good = {"Base Color": socket(value=(0.1, 0.2, 0.3, 1.0)), "Emission Strength": 2.0, "IOR": 0.8}
        export.range_notes(good.get, notes)
        self.assertEqual(notes, [])

    def test_other_nodes_are_listed(self):
        """Procedural textures, nodes after an image, other coordinates and projections, inputs without textures."""
        self.assertIn("Noise Texture", self.notes(node("TexNoise", "Noise Texture"))[0])
        ramp = node("ValToRGB", "Color Ramp", [socket("Fac", self.image())])
        self.assertIn("Color Ramp", self.notes(ramp)[0])
        partly = [socket("Factor", value=0.3), socket("A", self.image()), socket("B", value=(0.5, 0.5, 0.5, 1.0))]
        self.assertIn("Mix", self.notes(node("Mix", "Mix", partly, blend_type="MULTIPLY"))[0])
        self.assertIn(
            "Texture Coordinate", self.notes(self.image(node("TexCoord", "Texture Coordinate"), "Generated"))[0]
        )
        self.assertIn("box projection", self.notes(self.image(projection="BOX"))[0])
        self.assertIn("IOR", self.notes(self.image(), "IOR")[0])
        sum_node = node("Math", "Math", [socket("Value", self.image()), socket("Value")], operation="ADD")
        self.assertEqual(len(self.notes(sum_node, "Roughness")), 1)
        self.assertEqual(self.notes(sum_node, "Alpha"), [])


if __name__ == "__main__":
    if "--write" in sys.argv:
        EXAMPLE.write_text(example())
    else:
        unittest.main()
