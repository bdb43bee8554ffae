"""Exports a Blender scene for Dunkelfeld: geometry, materials and the camera as NAME.glb, all else as the job NAME.toml.

In Blender: File > Export > Dunkelfeld (.toml). In scripts, also without a window:

    import bpy, dunkelfeld_export
    notes = dunkelfeld_export.export(bpy.context, "station.toml")

`notes` lists the parts of the scene that a job cannot contain. The page docs/blender.md of Dunkelfeld has the conventions.
The functions before `import bpy` need no Blender.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import struct

bl_info = {
    "name": "Dunkelfeld export",
    "author": "Dunkelfeld contributors",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "File > Export > Dunkelfeld (.toml)",
    "description": "Writes a .glb and the job of an industrial camera's image",
    "category": "Import-Export",
}

# Width of a spot light's edge in cosines, relative to that of Blender: the edges have the same power and nearly the same middle.
# Cycles has a cubic step, whose mean is 1/2, Dunkelfeld the squared ramp of KHR_lights_punctual, whose mean is 1/3.
EDGE = 0.75
# The smallest f-number of a job.
LEAST_F_NUMBER = 0.5
# Width of the side panel that its notes do not have, in units of the scale of the interface.
MARGIN = 68.0
# Seconds of the units of a time; the longest time and exposure [s], and the largest number of samples of a job.
UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "": 1.0, "min": 60.0, "h": 3600.0}
YEAR = 365.0 * 24.0 * 3600.0
LONGEST_EXPOSURE = 1e6
MOST_SAMPLES = 1_000_000_000
# Largest radiance, intensity and irradiance of a job; its lengths [m]; its smallest spread [rad]; the sides of its film.
MOST_LIGHT = 1e12
LENGTHS = (1e-9, 1000.0)
LEAST_SPREAD = math.radians(1.0)
MOST_PIXELS = 32768
# Presets of sensors that the dialog proposes. A file of a sensor is allowed too.
SENSORS = ("imx174", "imx174-pointgrey", "imx178-color", "imx183", "imx250", "imx492", "imx900-hcg", "imx900-lcg")


# The job as text.


def quoted(text: str) -> str:
    """A basic string of TOML."""
    escapes = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return (
        '"' + "".join(escapes.get(c, c if ord(c) >= 32 and ord(c) != 127 else f"\\u{ord(c):04X}") for c in text) + '"'
    )


def value_text(value) -> str:
    """A TOML value. Numbers have the seven digits of single precision."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{value} cannot be written into a job")
        # The sum turns -0.0 into 0.0.
        text = f"{value + 0.0:.7g}"
        return text if any(c in text for c in ".e") else text + ".0"
    if isinstance(value, str):
        return quoted(value)
    return "[" + ", ".join(value_text(v) for v in value) + "]"


def job_text(top: dict, tables: list, notes: list) -> str:
    """The text of a job: comments with the notes, the keys of the file itself, then tables as (header, keys) pairs in their
    order. A header is written as it is, for example "film" or "[light]". Empty tables are left out."""
    lines = ["# Written by the Dunkelfeld export of Blender.", "#"]
    if notes:
        lines.append("# Not carried from Blender, or changed:")
        lines += [f"# - {' '.join(note.split())}" for note in notes]
    else:
        lines.append("# The whole scene was carried from Blender.")
    lines.append("")
    lines += [f"{key} = {value_text(value)}" for key, value in top.items()]
    for header, keys in tables:
        if keys:
            lines += ["", f"[{header}]"] + [f"{key} = {value_text(value)}" for key, value in keys.items()]
    return "\n".join(lines) + "\n"


def seconds_of(text: str):
    """The seconds of a time of a job, such as 5ms, 1min 30s, or a number of seconds; `None` if it is no time above 0."""
    parts = re.findall(
        r"((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?)\s*(ns|us|ms|s|min|h)?(?=\s|[0-9]|$)", text.strip()
    )
    rest = re.sub(r"\s+", "", "".join(number + unit for number, unit in parts))
    is_whole = bool(parts) and rest == re.sub(r"\s+", "", text)
    has_units = len(parts) == 1 or all(unit for _, unit in parts)
    seconds = sum(float(number) * UNITS[unit] for number, unit in parts)
    return seconds if is_whole and has_units and seconds > 0.0 else None


def is_time(text: str, most: float = YEAR) -> bool:
    """Is the text a time of a job above 0 and at most `most` seconds?"""
    seconds = seconds_of(text)
    return seconds is not None and seconds <= most


def check_settings(sensor: str, exposure: str, time: str, spp: int) -> None:
    """Raises an error with the name of the first setting that a job cannot have."""
    if sensor not in (*SENSORS, "none") and not sensor.endswith(".toml"):
        raise ValueError(f"sensor {sensor!r} is unknown: write one of {', '.join(SENSORS)}, none, or a file .toml")
    if sensor != "none" and exposure != "auto" and not is_time(exposure, LONGEST_EXPOSURE):
        raise ValueError(f"exposure {exposure!r} is no time of at most 1e6 s: write a time such as 5ms, or auto")
    if not 0 <= spp <= MOST_SAMPLES:
        raise ValueError(f"spp {spp} is not within 1 and {MOST_SAMPLES}: write a number of samples, or 0 for the time")
    if spp == 0 and not is_time(time):
        raise ValueError(f"time {time!r} is no time of at most a year: write a time such as 30s or 5min")


def wrapped(text: str, width: float, measure) -> list:
    """The lines of a text, each at most `width` wide by the function `measure`. A longer word is broken."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if measure(longer) <= width:
            lines[-1] = longer
            continue
        if lines[-1]:
            lines.append("")
        while len(word) > 1 and measure(word) > width:
            count = next((n for n in range(len(word) - 1, 1, -1) if measure(word[:n]) <= width), 1)
            lines[-1], word = word[:count], word[count:]
            lines.append("")
        lines[-1] = word
    return lines


def degrees(radians: float) -> str:
    """An angle of a job."""
    return f"{math.degrees(radians):.7g}deg"


# Conversions of numbers.


def to_gltf(v) -> list:
    """A vector of Blender (+z up) in the axes of glTF (+y up)."""
    return [float(v[0]), float(v[2]), -float(v[1])]


def within(value: float, low: float, high: float, what: str, notes: list) -> float:
    """The nearest value that a job can contain. A change is added to the notes."""
    nearest = min(max(value, low), high)
    if nearest != value:
        notes.append(f"{what} of {value:.3g}; a job has {low:.3g} to {high:.3g}, and {nearest:.3g} is used")
    return nearest


def light_within(values: list, what: str, notes: list, most: float = MOST_LIGHT) -> list:
    """A colour of light that a job can contain: no channel is negative."""
    if min(values) < 0.0:
        notes.append(f"a negative {what}, which a job cannot contain, becomes 0")
    if max(values) > most:
        notes.append(f"the {what} {max(values):.3g}; a job has at most {most:g}")
    return [min(max(c, 0.0), most) for c in values]


def srgb_table() -> list:
    """The linear values of the 256 values of an sRGB image of 8 bits (IEC 61966-2-1)."""
    values = [k / 255.0 for k in range(256)]
    return [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values]


def job_names(names: list) -> dict:
    """New names for those that a job would read as patterns: `*` and `?` become `_`. All names stay different."""
    taken, changed = set(names), {}
    for name in names:
        if not re.search(r"[*?]", name):
            continue
        new = re.sub(r"[*?]", "_", name)
        while new in taken:
            new += "_"
        taken.add(new)
        changed[name] = new
    return changed


class Names:
    """Names of the instances of objects: a name that is given again gets a number."""

    def __init__(self):
        self.counts: dict = {}

    def unique(self, name: str) -> str:
        """The name, or the name with the first free number."""
        if name not in self.counts:
            self.counts[name] = 1
            return name
        while True:
            self.counts[name] += 1
            numbered = f"{name}#{self.counts[name]}"
            if numbered not in self.counts:
                self.counts[numbered] = 1
                return numbered


def spread_gain(spread: float) -> float:
    """Radiance on the axis of an area light of this spread [rad, full angle], over that of a Lambertian of the same power."""
    half = 0.5 * spread
    if half > 0.5 * math.pi - 1e-4:
        return 1.0
    return math.tan(half) / (math.tan(half) - half)


def area_of(shape: str, width: float, height: float) -> float:
    """Area of an area light [m2]."""
    return width * height * (math.pi / 4.0 if shape in ("DISK", "ELLIPSE") else 1.0)


def film_extent(fit: str, width: int, height: int) -> int:
    """The number of pixels that `sensor_width`, shift and orthographic scale of a camera refer to."""
    return {"HORIZONTAL": width, "VERTICAL": height}.get(fit, max(width, height))


def f_number(radius: float, distance: float, image_distance: float, blades: int) -> float:
    """F-number of a thin lens whose aperture has this radius [m]. Blender's focal length is the distance from lens to film.
    Corners of Blender's polygon are on the circle; Dunkelfeld's polygon has the area of the circle."""
    focal = 1.0 / (1.0 / distance + 1.0 / image_distance)
    corner = math.sqrt(2.0 * math.pi / (blades * math.sin(2.0 * math.pi / blades))) if blades >= 3 else 1.0
    return focal / (2.0 * radius) * corner


# The JSON chunk of a GLB.


def change_glb(path: str, change) -> None:
    """Calls `change` with the JSON of a GLB as a dictionary, and writes the file again."""
    with open(path, "rb") as file:
        data = file.read()
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    change(document)
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    with open(path, "wb") as file:
        file.write(struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest)


def diffuse_surface(color: list) -> dict:
    """A material of glTF without a specular reflection."""
    surface = {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    return {"pbrMetallicRoughness": surface, "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}


def change_materials(document: dict, plain: dict, renamed: dict) -> None:
    """Makes the materials of `plain` diffuse of this colour, and renames. Emitters become double-sided, and meshes without a material get the one of Cycles, diffuse of reflectance
    0.8."""
    materials = document.setdefault("materials", [])
    bare = [p for mesh in document.get("meshes", []) for p in mesh.get("primitives", []) if "material" not in p]
    for primitive in bare:
        primitive["material"] = len(materials)
    if bare:
        materials.append({"name": "no material"} | diffuse_surface([0.8, 0.8, 0.8, 1.0]))
    is_plain = False
    for material in materials:
        name = material.get("name")
        if name in plain:
            is_plain = True
            kept = {key: material[key] for key in ("name", "doubleSided") if key in material}
            material.clear()
            material.update(kept | diffuse_surface([min(max(c, 0.0), 1.0) for c in plain[name]] + [1.0]))
        if any(material.get("emissiveFactor", [])):
            material["doubleSided"] = True
        if name in renamed:
            material["name"] = renamed[name]
    if bare or is_plain:
        names = document.setdefault("extensionsUsed", [])
        names += [name for name in ("KHR_materials_specular",) if name not in names]
    if not materials:
        del document["materials"]


def rename_parts(document: dict, nodes: dict, meshes: dict) -> None:
    """Gives nodes and meshes of a glTF their names in Blender in place of those of their copies."""
    for part, names in ((document.get("nodes", []), nodes), (document.get("meshes", []), meshes)):
        for entry in part:
            entry["name"] = names.get(entry.get("name"), entry.get("name", ""))


try:
    import bpy
except ImportError:
    bpy = None


# Materials.


def constant(socket):
    """The value of a socket without a link, as a float or a list; `None` with a link."""
    if socket.is_linked:
        node = socket.links[0].from_node
        if node.bl_idname == "ShaderNodeValue":
            return float(node.outputs[0].default_value)
        if node.bl_idname == "ShaderNodeRGB":
            return [float(c) for c in node.outputs[0].default_value][:3]
        return None
    value = socket.default_value
    return float(value) if isinstance(value, (int, float)) else [float(c) for c in value][:3]


def source(socket):
    """The node at the other end of a link, past reroutes; `None` without a link."""
    while socket.is_linked:
        link = socket.links[0]
        if link.from_node.bl_idname != "NodeReroute":
            return link.from_node
        socket = link.from_node.inputs[0]
    return None


def active_output(tree, kind: str):
    """The output node that Cycles uses."""
    outputs = [n for n in tree.nodes if n.bl_idname == kind and n.target in ("ALL", "CYCLES")]
    return next((n for n in outputs if n.is_active_output), outputs[0] if outputs else None)


class Surface:
    """A surface as inputs of the Principled BSDF: socket, number or list by the name of the input."""

    def __init__(self):
        self.inputs = {"Base Color": [0.0, 0.0, 0.0], "Metallic": 0.0, "Roughness": 1.0}
        self.inputs |= {"Specular IOR Level": 0.0, "Emission Strength": 0.0}
        # Glass; lobes with the energy of multiple scattering.
        self.is_clear = False
        self.is_compensated = False
        # Inputs whose links Blender's glTF exporter would read in another sense.
        self.unlinked: list = []


def surface_of(node, notes: list) -> Surface:
    """The surface of a shader node that is no Principled BSDF. Differences are added to the notes."""
    s, kind = Surface(), node.bl_idname if node else ""
    if node and "Normal" in node.inputs and is_normal_map(source(node.inputs["Normal"])):
        s.inputs["Normal"] = node.inputs["Normal"]
    elif node and "Normal" in node.inputs and source(node.inputs["Normal"]) is not None:
        notes.append(f"{title(source(node.inputs['Normal']))} is left out; a Normal Map in tangent space is carried")
    if kind == "ShaderNodeBsdfDiffuse":
        s.inputs["Base Color"] = node.inputs["Color"]
        if constant(node.inputs["Roughness"]) != 0.0:
            notes.append("the roughness of a Diffuse BSDF (Oren-Nayar) becomes 0")
    elif kind in ("ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfGlossy"):
        s.inputs |= {"Base Color": node.inputs["Color"], "Metallic": 1.0, "Roughness": node.inputs["Roughness"]}
        s.is_compensated = node.distribution == "MULTI_GGX"
        if "Anisotropy" in node.inputs and constant(node.inputs["Anisotropy"]) != 0.0:
            notes.append("the anisotropy of a Glossy BSDF becomes 0; use a Principled BSDF")
    elif kind in ("ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction"):
        s.inputs |= {
            "Base Color": node.inputs["Color"],
            "Roughness": node.inputs["Roughness"],
            "IOR": node.inputs["IOR"],
        }
        s.inputs |= {"Transmission Weight": 1.0, "Specular IOR Level": 0.5}
        s.is_clear, s.is_compensated = True, node.distribution == "MULTI_GGX"
        color = constant(node.inputs["Color"])
        if color is None:
            notes.append("a texture of the colour of glass tints each slab once, not once at each face")
        elif color != [1.0, 1.0, 1.0]:
            # Cycles tints once at each face, Dunkelfeld by the root.
            s.inputs["Base Color"] = [c * c for c in color]
            notes.append("the colour of glass tints transmitted light only, not the reflection")
        if kind == "ShaderNodeBsdfRefraction":
            notes.append("a Refraction BSDF becomes glass: it reflects too")
    elif kind == "ShaderNodeEmission":
        s.inputs |= {"Emission Color": node.inputs["Color"], "Emission Strength": node.inputs["Strength"]}
    elif kind == "ShaderNodeAddShader":
        parts = [source(i) for i in node.inputs]
        emitters = [p for p in parts if p and p.bl_idname == "ShaderNodeEmission"]
        others = [p for p in parts if p and p.bl_idname != "ShaderNodeEmission"]
        if len(emitters) == 1 and len(others) == 1 and others[0].bl_idname != "ShaderNodeBsdfPrincipled":
            s = surface_of(others[0], notes)
            s.inputs |= {
                "Emission Color": emitters[0].inputs["Color"],
                "Emission Strength": emitters[0].inputs["Strength"],
            }
        else:
            notes.append("an Add Shader other than a BSDF and an Emission is not supported: black")
    elif kind == "ShaderNodeMixShader":
        first, second = source(node.inputs[1]), source(node.inputs[2])
        share = constant(node.inputs[0])
        if first and first.bl_idname == "ShaderNodeBsdfTransparent" and second and share is not None:
            s = surface_of(second, notes)
            s.inputs["Alpha"] = share
        elif second and second.bl_idname == "ShaderNodeBsdfTransparent" and first and share is not None:
            s = surface_of(first, notes)
            s.inputs["Alpha"] = 1.0 - share
        else:
            notes.append(
                "a Mix Shader other than one with a Transparent BSDF and a constant factor is not supported: black"
            )
    elif kind == "ShaderNodeBsdfTransparent":
        s.inputs["Alpha"] = 0.0
    elif kind == "ShaderNodeBsdfPrincipled":
        notes.append("a Principled BSDF behind a Mix or Add Shader is not supported: black")
    elif node is None:
        notes.append("no surface shader: black")
    else:
        notes.append(f"the node {title(node)} is not supported: black")
    return s


def principled(node, notes: list) -> Surface:
    """Properties of a Principled BSDF, which Blender's glTF exporter reads itself."""
    s = Surface()
    number = lambda name, default=0.0: constant(node.inputs[name]) if name in node.inputs else default
    left_out = ("Subsurface Weight", "Thin Film Thickness", "Diffuse Roughness")
    for name in left_out:
        if number(name) != 0.0:
            notes.append(f"{name} is left out")
    if number("Sheen Weight") != 0.0:
        notes.append("the sheen has another shape, and the weight 1")
    if number("Coat Weight") != 0.0 and (number("Coat IOR", 1.5) != 1.5 or number("Coat Tint", [1.0] * 3) != [1.0] * 3):
        notes.append("the coat has the index 1.5 and no tint")
    transmission = number("Transmission Weight")
    s.is_clear = transmission is None or transmission > 0.0
    s.is_compensated = node.distribution == "MULTI_GGX"
    if transmission not in (0.0, 1.0) and transmission is not None:
        notes.append("a Transmission Weight between 0 and 1 is mixed in another way than in Cycles")
    for socket in node.inputs:
        if source(socket) is None or socket.name in left_out:
            continue
        if socket.name == "Normal" and not is_normal_map(source(socket)):
            s.unlinked.append(socket)
            notes.append(f"{title(source(socket))} is left out; a Normal Map in tangent space is carried")
        elif constant(socket) is None:
            texture_notes(socket.name, socket, notes)
    return s


# Inputs of a Principled BSDF whose textures are carried.
TEXTURED = (
    "Base Color",
    "Metallic",
    "Roughness",
    "Alpha",
    "Normal",
    "Emission Color",
    "Specular IOR Level",
    "Specular Tint",
)
TEXTURED += ("Transmission Weight", "Coat Weight", "Coat Roughness", "Sheen Tint", "Sheen Roughness", "Tangent")
COLORS = ("Base Color", "Emission Color", "Specular Tint", "Sheen Tint")
LINEAR_SPACES = ("Linear Rec.709", "Linear", "Non-Color")
COLOR_ATTRIBUTES = ("ShaderNodeVertexColor", "ShaderNodeAttribute")
TEXTURES = ("ShaderNodeTexImage", *COLOR_ATTRIBUTES, "ShaderNodeValue", "ShaderNodeRGB")


def title(node) -> str:
    """The name of a node, with its kind if the name does not have it."""
    return node.name if node.name.startswith(node.bl_label) else f"{node.name} ({node.bl_label})"


def is_normal_map(node) -> bool:
    """Is it a node that glTF has too?"""
    return node is not None and node.bl_idname == "ShaderNodeNormalMap" and node.space == "TANGENT"


def texture_notes(name: str, socket, notes: list) -> None:
    """Adds the differences of the texture at an input of this name. Blender's glTF exporter finds an image behind any nodes,
    and drops most of these nodes."""
    end = source(socket)
    if name not in TEXTURED:
        notes.append(f"the texture of {name} is left out")
    elif not reaches_image(end):
        notes.append(f"{name} comes from {title(end)}, which is no image texture: left out")
    else:
        lost: list = []
        lost_nodes(name, end, lost)
        if lost:
            notes.append(f"between the texture and {name}, these nodes are left out: {', '.join(dict.fromkeys(lost))}")


def reaches_image(node, depth: int = 0) -> bool:
    """Is there an image, a vertex colour or a constant behind this node?"""
    if node.bl_idname in TEXTURES:
        return True
    return depth < 16 and any(reaches_image(source(i), depth + 1) for i in node.inputs if source(i) is not None)


def is_planar(mapping) -> bool:
    """Is a Mapping node a constant transform of the plane, as glTF has it?"""
    inputs = [mapping.inputs[name] for name in ("Location", "Rotation", "Scale") if name in mapping.inputs]
    if any(constant(i) is None for i in inputs):
        return False
    turn = constant(mapping.inputs["Rotation"]) if "Rotation" in mapping.inputs else [0.0, 0.0, 0.0]
    return not any(turn[:2]) and getattr(mapping, "vector_type", "POINT") != "NORMAL"


def lost_nodes(name: str, node, lost: list, depth: int = 0) -> None:
    """Adds the nodes that glTF does not have, from the input `name` of a Principled BSDF back to the images."""
    if node.bl_idname == "ShaderNodeTexImage":
        end = node.inputs["Vector"]
        count = 0
        while source(end) is not None and source(end).bl_idname == "ShaderNodeMapping":
            mapping, count = source(end), count + 1
            if count > 1 or not is_planar(mapping):
                lost.append(title(mapping))
            end = mapping.inputs["Vector"]
        way = source(end)
        is_uv = way is None or way.bl_idname == "ShaderNodeUVMap"
        if not is_uv and not (way.bl_idname == "ShaderNodeTexCoord" and end.links[0].from_socket.name == "UV"):
            lost.append(f"{title(way)} (UV coordinates are used)")
        if node.projection != "FLAT":
            lost.append(f"the {node.projection.lower()} projection of {title(node)}")
        if getattr(node, "extension", "REPEAT") == "CLIP":
            lost.append(f"the black border of {title(node)}")
        image = getattr(node, "image", None)
        if image is None and hasattr(node, "image"):
            lost.append(f"{title(node)}, as its image is missing")
        if image is not None and not image.is_float and name != "Alpha":
            # A file of glTF has sRGB colours and linear values of all else.
            space = image.colorspace_settings.name
            if (space != "sRGB") if name in COLORS else (space not in LINEAR_SPACES):
                lost.append(
                    f"the colour space {space} of {title(node)} ({'sRGB' if name in COLORS else 'linear'} is used)"
                )
    if node.bl_idname == "ShaderNodeAttribute" and getattr(node, "attribute_type", "GEOMETRY") != "GEOMETRY":
        lost.append(f"{title(node)} of the {node.attribute_type.lower()}")
    if node.bl_idname in TEXTURES or depth >= 16:
        return
    linked = [socket for socket in node.inputs if source(socket) is not None]
    # A product with a constant becomes a factor of glTF, one with a colour attribute the colours of vertices. For alpha,
    # comparisons with a constant become its cutoff.
    varying = [i for i in linked if constant(i) is None and source(i).bl_idname not in COLOR_ATTRIBUTES]
    is_product = len(varying) <= 1 and getattr(node, "blend_type", getattr(node, "operation", "")) == "MULTIPLY"
    if "Factor" in node.inputs or "Fac" in node.inputs:
        factor = node.inputs["Factor" if "Factor" in node.inputs else "Fac"]
        is_product = is_product and constant(factor) == 1.0
    is_cutoff = name == "Alpha" and node.bl_idname == "ShaderNodeMath"
    if node.bl_idname not in ("ShaderNodeSeparateColor", "ShaderNodeNormalMap") and not is_product and not is_cutoff:
        lost.append(title(node))
    for socket in linked:
        lost_nodes(name, source(socket), lost, depth + 1)


def range_notes(inputs, notes: list) -> None:
    """Adds constants of a surface that a file of glTF cannot contain. `inputs` gives sockets, numbers or lists by name."""

    def known(name: str, default):
        """The constant of an input."""
        value = inputs(name)
        value = value if value is None or isinstance(value, (int, float, list)) else constant(value)
        return default if value is None else value

    color = known("Base Color", [0.0])
    if max(color) > 1.0:
        notes.append(f"a base colour of {max(color):.3g} becomes 1")
    if min(color) < 0.0:
        notes.append("a negative base colour becomes 0")
    if known("Emission Strength", 0.0) * min(known("Emission Color", [0.0])) < 0.0:
        notes.append("a negative emission becomes 0")
    if known("Transmission Weight", 0.0) > 0.0 and known("IOR", 1.5) < 1.0:
        notes.append(f"the index {known('IOR', 1.5):.3g} becomes 1")


def volume_of(node, notes: list) -> dict:
    """Keys of `[[material]]` for the volume of a material."""
    kind = node.bl_idname
    if kind not in ("ShaderNodeVolumeAbsorption", "ShaderNodeVolumeScatter"):
        notes.append(f"the volume node {title(node)} is left out")
        return {}
    color, density = constant(node.inputs["Color"]), constant(node.inputs["Density"])
    if color is None or density is None:
        notes.append(f"textures of {title(node)}: the volume is left out")
        return {}
    if kind == "ShaderNodeVolumeAbsorption":
        absorption = [within(density * max(1.0 - c, 0.0), 0.0, 1e9, "an absorption", notes) for c in color]
        return {"absorption": absorption, "scattering": 0.0}
    if getattr(node, "phase", "HENYEY_GREENSTEIN") != "HENYEY_GREENSTEIN":
        notes.append(f"the phase function of {node.name}; Henyey-Greenstein is used")
    anisotropy = within(constant(node.inputs["Anisotropy"]) or 0.0, -0.9999, 0.9999, "an anisotropy", notes)
    scattering = [within(density * c, 0.0, 1e9, "a scattering coefficient", notes) for c in color]
    return {"absorption": 0.0, "scattering": scattering, "scattering_anisotropy": anisotropy}


class Materials:
    """Materials of a scene: the nodes that replace surfaces during the export, and tables of the job."""

    def __init__(self):
        self.replaced, self.undo, self.tables = [], [], []
        # Colours of the materials that become diffuse in the file; new names of materials.
        self.plain: dict = {}
        self.renamed: dict = {}
        self.unlinked, self.relink = [], []
        self.is_compensated = False

    def survey(self, used: dict, notes: list) -> None:
        """Reads materials; `used` has the names of their objects, and of those that are not closed."""
        self.renamed = job_names([material.name for material in used])
        for material, (objects, open_objects) in used.items():
            own: list = []
            keys: dict = {}
            tree = material.node_tree if material.use_nodes else None
            output = active_output(tree, "ShaderNodeOutputMaterial") if tree else None
            if sum(other.name == material.name for other in used) > 1:
                own.append("a material of another file has the same name, and both are changed in the same way")
            if material.name in self.renamed:
                own.append(f"it is named {self.renamed[material.name]}: a job reads * and ? as wildcards")
            if output is None:
                # Cycles has a diffuse surface for a material without nodes.
                self.plain[material.name] = [0.0] * 3 if tree else [float(c) for c in material.diffuse_color][:3]
                if tree:
                    own.append("no output node: black")
                elif material.metallic > 0.0:
                    own.append("it has no nodes: diffuse, as in Cycles; its metallic value is left out")
                notes += [f"material {material.name}: {note}" for note in own]
                continue
            node = source(output.inputs["Surface"])
            volume = source(output.inputs["Volume"])
            if node is not None and node.bl_idname == "ShaderNodeBsdfPrincipled":
                s = principled(node, own)
                range_notes(node.inputs.get, own)
                self.unlinked += [(tree, socket) for socket in s.unlinked]
            elif node is None and volume is not None:
                s = Surface()
                s.inputs |= {"Base Color": [1.0, 1.0, 1.0], "Transmission Weight": 1.0, "Roughness": 0.0, "IOR": 1.0}
                s.is_clear = True
                keys["ior"] = 1.0
                self.replaced.append((material, output, s))
            else:
                s = surface_of(node, own)
                range_notes(s.inputs.get, own)
                for name, value in s.inputs.items():
                    if (
                        not isinstance(value, (int, float, list))
                        and source(value) is not None
                        and constant(value) is None
                    ):
                        texture_notes(name, value, own)
                self.replaced.append((material, output, s))
            self.is_compensated |= s.is_compensated
            if output.inputs["Displacement"].is_linked:
                own.append("displacement is left out")
            if s.is_clear:
                if open_objects:
                    own.append(
                        "it is clear, but the mesh is not closed: a thin sheet that does not refract: "
                        + ", ".join(open_objects)
                    )
                else:
                    keys["solid"] = True
                    if volume is not None:
                        keys |= volume_of(volume, own)
            elif volume is not None:
                own.append("the volume behind an opaque surface is left out")
            if keys:
                name = self.renamed.get(material.name, material.name)
                self.tables.append(("[material]", {"name": name} | keys))
            notes += [f"material {material.name}: {note}" for note in own]

    def replace(self) -> None:
        """Links a Principled BSDF to the output of each material that has another surface."""
        for tree, socket in self.unlinked:
            self.relink.append((tree, socket.links[0].from_socket, socket))
            tree.links.remove(socket.links[0])
        for material, output, s in self.replaced:
            tree = material.node_tree
            node = tree.nodes.new("ShaderNodeBsdfPrincipled")
            before = output.inputs["Surface"].links[0].from_socket if output.inputs["Surface"].is_linked else None
            self.undo.append((tree, node, output, before))
            for name, value in s.inputs.items():
                if not isinstance(value, (int, float, list)):
                    if value.is_linked:
                        tree.links.new(value.links[0].from_socket, node.inputs[name])
                        continue
                    value = constant(value)
                node.inputs[name].default_value = [*value, 1.0] if isinstance(value, list) else value
            tree.links.new(node.outputs[0], output.inputs["Surface"])

    def restore(self) -> None:
        """Brings the nodes back."""
        for tree, node, output, before in reversed(self.undo):
            tree.nodes.remove(node)
            if before is not None:
                tree.links.new(before, output.inputs["Surface"])
        self.undo.clear()
        for tree, start, end in self.relink:
            tree.links.new(start, end)
        self.relink.clear()


# Lights.


def length(vector) -> float:
    """Euclidean length."""
    return math.sqrt(sum(float(c) * float(c) for c in vector))


def light_strength(light, notes: list) -> list:
    """Colour of a light times the constants of its nodes, linear Rec. 709."""
    color = [float(c) for c in light.color]
    if getattr(light, "use_temperature", False):
        color = [a * float(b) for a, b in zip(color, light.temperature_color)]
    color = [c * 2.0 ** getattr(light, "exposure", 0.0) for c in color]
    if light.use_nodes and light.node_tree:
        output = active_output(light.node_tree, "ShaderNodeOutputLight")
        node = source(output.inputs["Surface"]) if output else None
        factor, tint = 1.0, [1.0, 1.0, 1.0]
        if node is None or node.bl_idname != "ShaderNodeEmission":
            notes.append("its nodes are not an Emission; the light is used without its nodes")
        else:
            factor, tint = constant(node.inputs["Strength"]), constant(node.inputs["Color"])
            if factor is None or tint is None:
                notes.append("textures, IES profiles and falloffs of its nodes are left out")
                factor, tint = 1.0 if factor is None else factor, [1.0, 1.0, 1.0] if tint is None else tint
        color = [c * factor * t for c, t in zip(color, tint)]
    return color


def light_table(name: str, light, matrix, notes: list) -> dict:
    """A `[[light]]` of the job: place, axis and strength of a light of Blender with this matrix to the world."""
    axes = [[float(matrix[row][column]) for row in range(3)] for column in range(3)]
    scale = [length(axis) for axis in axes]
    if min(scale) == 0.0:
        notes.append("its scale is 0")
        return {}
    unit = [[c / s for c in axis] for axis, s in zip(axes, scale)]
    position, aim = to_gltf([matrix[row][3] for row in range(3)]), to_gltf([-c for c in unit[2]])
    normalized, energy = getattr(light, "normalize", True), float(light.energy)
    strength = [c * energy for c in light_strength(light, notes)]
    color = light_within(strength, "strength", notes, math.inf)
    if min(strength) < 0.0 and not any(color):
        notes.append("it gives no light and is left out")
        return {}
    table: dict = {"name": name}
    if light.type == "SUN":
        angle = float(light.angle)
        disc = math.pi * math.sin(0.5 * angle) ** 2 if angle > 0.0 else 1.0
        irradiance = 1.0 if normalized else disc
        table |= {"kind": "sun", "aim": aim, "angle": degrees(angle)}
        return table | {"irradiance": light_within([c * irradiance for c in color], "irradiance", notes)}
    if light.type == "AREA":
        width = float(light.size) * scale[0]
        height = float(light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size) * scale[1]
        if width > 0.0 and height > 0.0:
            width = within(width, *LENGTHS, "a width [m]", notes)
            height = within(height, *LENGTHS, "a height [m]", notes)
        if abs(sum(a * b for a, b in zip(unit[0], unit[1]))) > 1e-4:
            notes.append("its shear is left out")
        area = area_of(light.shape, width, height)
        if area == 0.0:
            notes.append("its size is 0")
            return {}
        spread = float(light.spread)
        if spread < LEAST_SPREAD:
            notes.append(f"a spread of {math.degrees(spread):.3g} degrees; 1 degree is used, with the same power")
            spread = LEAST_SPREAD
        radiance = (1.0 if normalized else area) / (math.pi * area) * spread_gain(spread)
        table |= {"kind": "panel", "position": position, "aim": aim, "up": to_gltf(unit[1])}
        is_round = light.shape in ("DISK", "ELLIPSE")
        table |= {"diameter" if is_round else "width": width}
        if not (is_round and abs(width - height) < 1e-6 * width):
            table["height"] = height
        if spread < math.pi - 1e-4:
            table["spread"] = degrees(spread)
        return table | {"radiance": light_within([c * radiance for c in color], "radiance", notes), "body": False}
    # Point and spot lights: their extent is not scaled.
    radius = float(light.shadow_soft_size)
    power = 1.0 if normalized else 4.0 * math.pi * radius * radius if radius > 0.0 else 4.0
    intensity = light_within([c * power / (4.0 * math.pi) for c in color], "intensity", notes)
    table |= {"kind": "spot" if light.type == "SPOT" else "point", "position": position}
    if light.type == "SPOT":
        if max(scale) - min(scale) > 1e-4 * max(scale):
            notes.append("its scale, which stretches the cone, is left out")
        table |= {"aim": aim, "cone_angle": degrees(light.spot_size), "blend": EDGE * float(light.spot_blend)}
    if radius > 0.0:
        table["diameter"] = within(2.0 * radius, *LENGTHS, "a diameter [m]", notes)
    return table | {"intensity": intensity}


def has_extent(table: dict) -> bool:
    """Can a camera have an image of the light of this table?"""
    return table["kind"] == "panel" or "diameter" in table or table.get("angle", degrees(0.0)) != degrees(0.0)


# Kinds of rays of Cycles that may miss an object, without those of shadows.
RAYS = ("camera", "diffuse", "glossy", "transmission", "volume_scatter")


def instance_name(instance) -> str:
    """The name of an instance of the depsgraph: that of its object, after that of the instancer if there is one."""
    thing = instance.object.original
    owner = instance.parent.original if instance.is_instance and instance.parent is not None else thing
    return thing.name if owner == thing else f"{owner.name}/{thing.name}"


def is_shown(instance) -> bool:
    """Does a render show an instance of the depsgraph? An object that its parent copies to vertices or faces is hidden itself."""
    to_elements = lambda thing: thing is not None and thing.original.instance_type in ("VERTS", "FACES")
    is_copy = instance.is_instance and to_elements(instance.parent)
    return instance.show_self and (is_copy or not to_elements(instance.object.parent))


def lights_of(depsgraph, notes: list) -> list:
    """The lights of the scene, those of instances too, as tables of the job."""
    tables, names = [], Names()
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.type != "LIGHT" or not is_shown(instance):
            continue
        own: list = []
        name = names.unique(instance_name(instance))
        light = thing.data
        settings = getattr(light, "cycles", None)
        if light.type == "AREA" and getattr(settings, "is_portal", False):
            notes.append(f"light {name}: a portal gives no light")
            continue
        hidden = [ray for ray in RAYS if ray != "camera" and not getattr(thing, f"visible_{ray}", True)]
        if hidden:
            own.append(f"it lights all; in Blender it is not visible to {', '.join(hidden).replace('_', ' ')} rays")
        if not getattr(light, "use_shadow", True):
            own.append("it casts shadows; in Blender it does not")
        if light.type == "POINT" and light.shadow_soft_size > 0.0 and getattr(light, "use_soft_falloff", False):
            own.append("Soft Falloff: the light is a sphere, whose light near it is stronger")
        table = light_table(name, light, instance.matrix_world, own)
        if table:
            tables.append(("[light]", table))
        notes += [f"light {name}: {note}" for note in own]
    return tables


# World and camera.


def rotation_of(node, notes: list) -> float:
    """Rotation [rad] about +z of the texture coordinates of an environment."""
    mapping = source(node.inputs["Vector"])
    if mapping is None or mapping.bl_idname == "ShaderNodeTexCoord":
        if mapping is not None and node.inputs["Vector"].links[0].from_socket.name != "Generated":
            notes.append("world: the texture coordinates of the environment; the world's are used")
        return 0.0
    inputs = mapping.inputs
    if mapping.bl_idname != "ShaderNodeMapping":
        notes.append(f"world: {title(mapping)} of the environment's coordinates is left out")
        return 0.0
    turn = constant(inputs["Rotation"]) or [0.0, 0.0, 0.0]
    # A texture mapping applies the inverse.
    sign = -1.0 if mapping.vector_type == "TEXTURE" else 1.0
    location = constant(inputs["Location"]) if "Location" in inputs else None
    moved = location is not None and any(location) and mapping.vector_type in ("POINT", "TEXTURE")
    if turn[0] or turn[1] or moved or constant(inputs["Scale"]) != [1.0, 1.0, 1.0]:
        notes.append("world: location, scale and tilt of the environment's mapping are left out")
    return sign * turn[2]


def environment_of(scene, stem: str, write: bool, notes: list) -> dict:
    """The `[environment]` of the job. An image is written beside it if `write` is set."""
    world = scene.world
    if world is None:
        return {}
    if not (world.use_nodes and world.node_tree):
        return {"radiance": world_light([float(c) for c in world.color], notes)}
    rays = ("camera", "diffuse", "glossy", "transmission", "scatter")
    hidden = [ray for ray in rays if not getattr(getattr(world, "cycles_visibility", None), ray, True)]
    if hidden:
        notes.append(f"world: it is visible to all rays; in Blender not to {', '.join(hidden)} rays")
    output = active_output(world.node_tree, "ShaderNodeOutputWorld")
    if output is None:
        return {}
    if output.inputs["Volume"].is_linked:
        notes.append("world: its volume is left out")
    node = source(output.inputs["Surface"])
    if node is None:
        return {}
    strength = (
        constant(node.inputs["Strength"]) if node.bl_idname in ("ShaderNodeBackground", "ShaderNodeEmission") else None
    )
    if strength is None:
        notes.append(f"world: the node {title(node)} or its strength is not supported; the world is dark")
        return {}
    color = constant(node.inputs["Color"])
    if color is not None:
        return {"radiance": world_light([c * strength for c in color], notes)}
    texture = source(node.inputs["Color"])
    if (
        texture.bl_idname != "ShaderNodeTexEnvironment"
        or texture.image is None
        or texture.projection != "EQUIRECTANGULAR"
    ):
        notes.append(f"world: {texture.name} is no equirectangular Environment Texture; the world is dark")
        return {}
    image = texture.image
    path = os.path.abspath(bpy.path.abspath(image.filepath, library=image.library))
    ending = os.path.splitext(path)[1].lower()
    if not all(image.size):
        notes.append(f"world: the image {image.name} cannot be read; the world is dark")
        return {}
    space = image.colorspace_settings.name
    # Blender's values of an image of 8 bits are those of the file, all others are linear Rec. 709.
    is_linear = space in LINEAR_SPACES
    if not (is_linear or image.is_float or space == "sRGB"):
        notes.append(f"world: the colour space {space} of {image.name}; its values are decoded as sRGB")
    is_file = is_linear and ending in (".exr", ".hdr") and os.path.isfile(path) and not image.packed_file
    target = f"{stem}_world{ending if is_file else '.exr'}"
    if write and is_file:
        if os.path.abspath(target) != path:
            shutil.copyfile(path, target)
    elif write:
        save_image(image, target, not (is_linear or image.is_float))
    # Blender has the middle of the image at +x, Dunkelfeld at -z.
    rotation = -0.5 * math.pi - rotation_of(texture, notes)
    table = {"image": os.path.basename(target), "rotation": degrees(math.remainder(rotation, 2.0 * math.pi))}
    return table | ({} if strength == 1.0 else {"scale": world_light([strength], notes)[0]})


def world_light(values: list, notes: list) -> list:
    """Radiance or scale of the world that a job can contain."""
    own: list = []
    values = light_within(values, "radiance", own)
    notes += [f"world: {note}" for note in own]
    return values


def save_image(image, path: str, is_encoded: bool) -> None:
    """Writes the linear values of an image as EXR with 32 bits. `is_encoded`: they are values of 8 bits, encoded as sRGB."""
    import numpy

    copy = bpy.data.images.new("dunkelfeld", *image.size, alpha=False, float_buffer=True)
    try:
        copy.colorspace_settings.name = "Non-Color"
        values = numpy.empty(len(image.pixels), numpy.float32)
        image.pixels.foreach_get(values)
        if is_encoded:
            # The pixels have four channels; alpha is not encoded.
            colors = values.reshape(-1, 4)[:, :3]
            colors[:] = numpy.asarray(srgb_table(), numpy.float32)[numpy.rint(255.0 * colors).astype(int).clip(0, 255)]
        copy.pixels.foreach_set(values)
        copy.filepath_raw, copy.file_format = path, "OPEN_EXR"
        copy.save()
    finally:
        bpy.data.images.remove(copy)


def camera_tables(scene, notes: list) -> tuple:
    """`[film]` and `[lens]` of the job, and the name of the camera."""
    camera, render = scene.camera, scene.render
    share = render.resolution_percentage / 100.0
    width, height = max(int(render.resolution_x * share), 1), max(int(render.resolution_y * share), 1)
    if max(width, height) > MOST_PIXELS:
        raise ValueError(f"the resolution {width} x {height} is too large: a side has at most {MOST_PIXELS} pixels")
    film: dict = {"width": width, "height": height}
    own: list = []
    if render.pixel_aspect_x != render.pixel_aspect_y:
        notes.append("camera: pixels are square; in Blender they are not")
    if render.use_border:
        notes.append("camera: the render region is left out; the whole image is rendered")
    if camera is None:
        notes.append("camera: the scene has none; the job frames the whole scene")
        return film, {}, None
    data = camera.data
    if camera.type != "CAMERA" or data.type not in ("PERSP", "ORTHO"):
        raise ValueError(
            f"the camera {camera.name} is panoramic or no camera: choose a perspective or orthographic one"
        )
    extent = film_extent(data.sensor_fit, width, height)
    size = 1e-3 * float(data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width)
    film["sensor_height"] = size * height / extent
    lens: dict = {}
    shift = [-float(data.shift_x) * extent, float(data.shift_y) * extent]
    dof = data.dof
    blades = int(dof.aperture_blades)
    distance = float(dof.focus_distance)
    matrix = camera.matrix_world
    if dof.focus_object is not None:
        target = dof.focus_object.matrix_world
        axis = [float(matrix[row][2]) for row in range(3)]
        distance = abs(sum(a * float(target[row][3] - matrix[row][3]) for row, a in enumerate(axis))) / length(axis)
    if data.type == "PERSP":
        focal = 1e-3 * float(data.lens)
        angle = math.degrees(2.0 * math.atan(0.5 * film["sensor_height"] / focal))
        lens["vertical_fov"] = f"{within(angle, 0.011, 178.0, 'a field of view [degrees]', own):.7g}deg"
        if dof.use_dof and distance > 0.0:
            number = f_number(focal / (2.0 * dof.aperture_fstop), distance, focal, blades)
            lens["f_number"] = within(number, LEAST_F_NUMBER, 1000.0, "an f-number", own)
    else:
        lens |= {"projection": "telecentric", "field_height": float(data.ortho_scale) * height / extent}
        lens["field_height"] = within(lens["field_height"], *LENGTHS, "a height of the field [m]", own)
        if dof.use_dof and distance > 0.0:
            # The aperture of an orthographic camera has the radius 1 / (2 N) metres.
            corner = f_number(0.5, 1e30, 1.0, blades)
            aperture = math.sin(math.atan2(0.5 / (float(dof.aperture_fstop) * corner), distance))
            magnification = film["sensor_height"] / lens["field_height"]
            most = 0.999 * magnification / (2.0 * LEAST_F_NUMBER * (1.0 + magnification))
            lens["numerical_aperture"] = max(min(aperture, most), 1e-6)
            if aperture > most:
                notes.append(
                    f"camera: a numerical aperture of {aperture:.3g}; {most:.3g} is used, f/{LEAST_F_NUMBER} on the sensor"
                )
    if any(shift):
        lens["principal_point"] = shift
    if dof.use_dof and distance > 0.0:
        lens["focus_distance"] = max(distance, 1e-6)
        if blades >= 3:
            lens |= {"blades": blades, "blade_rotation": degrees(dof.aperture_rotation)}
        if abs(dof.aperture_ratio - 1.0) > 1e-4:
            notes.append("camera: the ratio of an anamorphic aperture is left out")
    notes += [f"camera: {note}" for note in own]
    return film, lens, camera.name


# The whole scene.


class RenderView:
    """A `with` block in which the depsgraph has the scene as a render sees it: visibility, modifiers, resolutions and Simplify
    have their values of the render in place of those of the viewport. Its end restores all."""

    def __init__(self, context):
        self.context, self.before, self.hidden = context, [], []

    def set(self, thing, name: str, value) -> None:
        """Changes a property until the end of the block."""
        old = getattr(thing, name)
        if old != value:
            self.before.append((thing, name, old))
            setattr(thing, name, value)

    def set_pairs(self, thing, pairs: tuple) -> None:
        """Gives properties of the viewport the values of those of the render, as far as there are both."""
        for viewport, render in pairs:
            if hasattr(thing, viewport) and hasattr(thing, render):
                self.set(thing, viewport, getattr(thing, render))

    def change(self) -> None:
        """Sets the properties."""
        layer = self.context.view_layer
        for thing in layer.objects:
            if thing.hide_get(view_layer=layer):
                self.hidden.append(thing)
                thing.hide_set(False, view_layer=layer)
        parts = [layer.layer_collection]
        while parts:
            part = parts.pop()
            self.set(part, "hide_viewport", False)
            parts += part.children
        for collection in bpy.data.collections:
            self.set(collection, "hide_viewport", collection.hide_render)
        pairs = (("hide_viewport", "hide_render"), ("show_instancer_for_viewport", "show_instancer_for_render"))
        steps = (("show_viewport", "show_render"), ("levels", "render_levels"), ("steps", "render_steps"))
        steps += (("viewport_resolution", "resolution"),)
        for thing in bpy.data.objects:
            self.set_pairs(thing, pairs)
            for modifier in thing.modifiers:
                self.set_pairs(modifier, steps)
        for curve in bpy.data.curves:
            for axis in ("u", "v"):
                resolution = getattr(curve, f"render_resolution_{axis}", 0)
                if resolution > 0:
                    # The resolution of a curve replaces those of its splines.
                    name = f"resolution_{axis}"
                    self.before += [(spline, name, getattr(spline, name)) for spline in curve.splines]
                    self.before.append((curve, name, getattr(curve, name)))
                    setattr(curve, name, resolution)
        for ball in bpy.data.metaballs:
            self.set(ball, "resolution", ball.render_resolution)
        for particles in bpy.data.particles:
            self.set(particles, "display_percentage", 100)
            self.set(particles, "child_percent", particles.rendered_child_count)
        pairs = (("simplify_subdivision", "simplify_subdivision_render"),)
        pairs += (("simplify_child_particles", "simplify_child_particles_render"),)
        self.set_pairs(self.context.scene.render, pairs)

    def __enter__(self):
        try:
            self.change()
            self.context.view_layer.update()
            return self.context.evaluated_depsgraph_get()
        except BaseException:
            self.restore()
            raise

    def __exit__(self, *_):
        self.restore()

    def restore(self) -> None:
        """Brings the properties of the viewport back."""
        for thing, name, old in reversed(self.before):
            setattr(thing, name, old)
        self.before.clear()
        layer = self.context.view_layer
        for thing in self.hidden:
            thing.hide_set(True, view_layer=layer)
        self.hidden.clear()
        layer.update()


class Shape:
    """An evaluated mesh: the materials of its faces, and whether each of its edges has two faces."""

    def __init__(self, mesh, materials: list):
        import numpy

        self.materials = materials
        indices = numpy.zeros(len(mesh.polygons), numpy.int32)
        mesh.polygons.foreach_get("material_index", indices)
        self.indices = indices.clip(0, max(len(materials) - 1, 0))
        self.is_clamped = bool(materials) and bool((self.indices != indices).any())
        used = numpy.unique(self.indices) if materials else []
        self.used = [materials[k] for k in used if materials[k] is not None]
        edges = numpy.empty(len(mesh.loops), numpy.int32)
        mesh.loops.foreach_get("edge_index", edges)
        count = numpy.bincount(edges, minlength=len(mesh.edges))
        self.is_closed = bool(len(count)) and bool((count == 2).all())
        places = numpy.empty(3 * len(mesh.vertices), numpy.float32)
        mesh.vertices.foreach_get("co", places)
        places = places.reshape(-1, 3)
        low, high = places.min(axis=0), places.max(axis=0)
        self.corners = [[float((high if k >> axis & 1 else low)[axis]) for axis in range(3)] for k in range(8)]
        self.colors = {attribute.name for attribute in mesh.color_attributes}
        self.uv_maps = {layer.name for layer in mesh.uv_layers}
        # The copy that is exported.
        self.copy = None

    def keep(self, copy) -> None:
        """Gives the copy of the mesh the materials."""
        for k, material in enumerate(self.materials):
            if k < len(copy.materials):
                copy.materials[k] = material
            else:
                copy.materials.append(material)
        if self.is_clamped:
            copy.polygons.foreach_set("material_index", self.indices)
        self.copy = copy


def materials_of(thing) -> list:
    """Materials of an evaluated object, those of its mesh by Geometry Nodes too."""
    slots = [slot.material for slot in thing.material_slots]
    found = slots + list(thing.data.materials)[len(slots) :]
    return [material.original if material is not None else None for material in found]


class Parts:
    """The meshes of the render view: a name, a shape and a matrix to the world for each instance, and the objects that give
    or make them. `copies`: they are copied, for the export."""

    def __init__(self, depsgraph, copies: bool, notes: list):
        self.parts, self.sources, self.shapes, self.names = [], {}, {}, Names()
        try:
            self.read(depsgraph, copies, notes)
        except BaseException:
            self.remove()
            raise

    def read(self, depsgraph, copies: bool, notes: list) -> None:
        """Reads all instances."""
        left_out = set()
        for instance in depsgraph.object_instances:
            thing, original = instance.object, instance.object.original
            if not is_shown(instance):
                continue
            self.sources.setdefault(original)
            if instance.parent is not None:
                self.sources.setdefault(instance.parent.original)
            if thing.type in LEFT_OUT and (original, thing.type) not in left_out:
                left_out.add((original, thing.type))
                kind = thing.type.lower().replace("_", " ")
                notes.append(f"object {original.name}: it is left out; {kind} objects are not carried")
            # Curves, texts and metaballs have an instance with their mesh.
            if thing.type != "MESH":
                continue
            shape = self.shape(thing, depsgraph, copies)
            if shape is not None:
                name = self.names.unique(instance_name(instance))
                self.parts.append((name, original.name, shape, instance.matrix_world.copy()))

    def shape(self, thing, depsgraph, copies: bool):
        """The shape of an evaluated object; `None` without faces."""
        materials = materials_of(thing)
        key = (thing.data.as_pointer(), *materials)
        if key not in self.shapes:
            own = thing.original.evaluated_get(depsgraph)
            is_own = own.type == "MESH" and own.data.as_pointer() == thing.data.as_pointer()
            # The mesh of an object may wait for its subdivision; the meshes of Geometry Nodes are whole.
            mesh = own.to_mesh() if is_own else thing.data
            shape = Shape(mesh, materials) if len(mesh.polygons) else None
            if is_own:
                own.to_mesh_clear()
            if copies and shape is not None:
                whole = {"preserve_all_data_layers": True, "depsgraph": depsgraph}
                shape.keep(bpy.data.meshes.new_from_object(own, **whole) if is_own else thing.data.copy())
            self.shapes[key] = (shape, thing.original.data.name if is_own else thing.data.name)
        return self.shapes[key][0]

    def used(self) -> dict:
        """By material: the names of the objects with this material, and of those that are not closed."""
        used: dict = {}
        for _, name, shape, _ in self.parts:
            for material in shape.used:
                objects, open_objects = used.setdefault(material, ({}, {}))
                objects.setdefault(name)
                if not shape.is_closed:
                    open_objects.setdefault(name)
        return {material: (list(objects), list(others)) for material, (objects, others) in used.items()}

    def remove(self) -> None:
        """Removes the copies."""
        shapes = [shape for shape, _ in self.shapes.values() if shape is not None and shape.copy is not None]
        bpy.data.batch_remove([shape.copy for shape in shapes])
        for shape in shapes:
            shape.copy = None


# Kinds of objects that have no mesh in a render.
LEFT_OUT = ("CURVES", "VOLUME", "POINTCLOUD", "GREASEPENCIL", "GPENCIL")


def uses_viewport(tree, seen: set) -> bool:
    """Has a tree of Geometry Nodes the node Is Viewport?"""
    if tree is None or tree in seen:
        return False
    seen.add(tree)
    return any(
        node.bl_idname == "GeometryNodeIsViewport" or uses_viewport(getattr(node, "node_tree", None), seen)
        for node in tree.nodes
    )


def attribute_notes(parts: list, notes: list) -> None:
    """Attributes in materials that are no colours of the mesh, and UV maps that the mesh does not have."""
    found: dict = {}
    for name, shape in dict.fromkeys((name, shape) for _, name, shape, _ in parts):
        for material in shape.used:
            for node in material.node_tree.nodes if material.use_nodes and material.node_tree else ():
                text = lost_attribute(node, shape)
                if text:
                    found.setdefault(f"material {material.name}: {text}", {}).setdefault(name)
    notes += [f"{text} {', '.join(names)}" for text, names in found.items()]


def lost_attribute(node, shape) -> str:
    """The beginning of a note on an attribute that the shape does not have, up to the names of the objects; else nothing."""
    wanted = ""
    if node.bl_idname == "ShaderNodeAttribute" and node.attribute_type == "GEOMETRY":
        wanted = node.attribute_name
    if wanted and wanted not in shape.colors:
        return f"the attribute {wanted} is left out, as it is no colour attribute of"
    if node.bl_idname == "ShaderNodeUVMap" and node.uv_map and node.uv_map not in shape.uv_maps:
        return f"the UV map {node.uv_map} is missing, and another is used on"
    if node.bl_idname == "ShaderNodeTexImage" and not shape.uv_maps and any(o.is_linked for o in node.outputs):
        return f"without a UV map, the texture of {title(node)} is left out on"
    return ""


def pose_of(matrix) -> tuple:
    """The matrix of a camera without scale and shear, with the same axis, and whether there is a shear."""
    from mathutils import Matrix

    x, y, z = (matrix.col[k].to_3d().normalized() for k in range(3))
    is_sheared = max(abs(x.dot(y)), abs(y.dot(z)), abs(z.dot(x))) > 1e-4
    right = y.cross(z).normalized()
    pose = Matrix((right, z.cross(right), z)).transposed().to_4x4()
    pose.translation = matrix.translation
    return pose, is_sheared


def clip_notes(scene, camera, matrix, parts: list, notes: list) -> None:
    """Objects in view that Cycles cuts at the clip distances of the camera."""
    from mathutils import Vector

    data = camera.data
    if data.type not in ("PERSP", "ORTHO"):
        return
    into = matrix.inverted()
    is_wide = data.type == "PERSP"
    frame = [[c[k] / -c[2] if is_wide else c[k] for c in data.view_frame(scene=scene)] for k in range(2)]
    cut: dict = {}
    for _, name, shape, world in parts:
        corners = [into @ world @ Vector(corner) for corner in shape.corners]
        depths = [-corner[2] for corner in corners]
        # Objects beside the camera, such as a floor, and those with the camera inside are left out.
        if min(depths) <= 0.0 or data.clip_start <= min(depths) and max(depths) <= data.clip_end:
            continue
        seen = True
        for k in range(2):
            places = [corner[k] / depth if is_wide else corner[k] for corner, depth in zip(corners, depths)]
            seen = seen and min(places) < max(frame[k]) and max(places) > min(frame[k])
        if seen:
            cut.setdefault(name)
    if cut:
        notes.append(
            f"camera: its clip distances {data.clip_start:.3g} m and {data.clip_end:.3g} m, which cut {', '.join(cut)}, are left out"
        )


def object_notes(thing, notes: list) -> None:
    """Properties of an object that a job cannot contain."""
    label = f"object {thing.name}"
    for modifier in thing.modifiers:
        if modifier.type == "PARTICLE_SYSTEM" and modifier.show_render:
            system = modifier.particle_system
            if system.settings.render_type not in ("NONE", "OBJECT", "COLLECTION"):
                notes.append(f"{label}: particles and hair of {system.name} are left out")
        if modifier.type == "NODES" and modifier.show_render and uses_viewport(modifier.node_group, set()):
            notes.append(f"{label}: the node Is Viewport of {modifier.name} is true; in a render it is false")
    if any(m.type == "SUBSURF" and m.show_render for m in thing.modifiers) and (
        getattr(getattr(thing, "cycles", None), "use_adaptive_subdivision", False)
    ):
        notes.append(f"{label}: the adaptive subdivision is left out; its levels of a render are used")
    linking = getattr(thing, "light_linking", None)
    if linking is not None and (linking.receiver_collection or linking.blocker_collection):
        notes.append(f"{label}: light linking and shadow linking are left out")
    if thing.type != "LIGHT":
        hidden = [ray for ray in (*RAYS, "shadow") if not getattr(thing, f"visible_{ray}", True)]
        if hidden:
            notes.append(
                f"{label}: it is visible to all rays; in Blender not to {', '.join(hidden).replace('_', ' ')} rays"
            )
        if thing.is_shadow_catcher or thing.is_holdout:
            notes.append(f"{label}: it is visible; in Blender it is a shadow catcher or holdout")


def layer_notes(part, notes: list) -> None:
    """Properties of the collections of a view layer that a job cannot contain."""
    for child in part.children:
        if child.exclude:
            continue
        if child.holdout or child.indirect_only:
            kind = "a holdout" if child.holdout else "visible to indirect rays only"
            notes.append(f"collection {child.name}: its objects are visible to all rays; in Blender it is {kind}")
        layer_notes(child, notes)


class Survey:
    """What an export writes: materials, tables of the job, the name of the camera, meshes, matrices of cameras, and the notes,
    the list of all that a job cannot contain."""

    def __init__(self, context, copies: bool = False):
        self.notes: list = []
        with RenderView(context) as depsgraph:
            self.parts = Parts(depsgraph, copies, self.notes)
            try:
                self.read(context, depsgraph)
            except BaseException:
                self.parts.remove()
                raise

    def read(self, context, depsgraph) -> None:
        """Reads all but the meshes."""
        scene, notes = context.scene, self.notes
        for thing in self.parts.sources:
            object_notes(thing, notes)
        layer_notes(context.view_layer.layer_collection, notes)
        # The active camera may be hidden, or in another scene.
        cameras = [thing for thing in scene.objects if thing.type == "CAMERA" and not thing.hide_render]
        if scene.camera is not None and scene.camera.type == "CAMERA" and scene.camera not in cameras:
            cameras.append(scene.camera)
        self.cameras = []
        for camera in cameras:
            matrix, is_sheared = pose_of(camera.evaluated_get(depsgraph).matrix_world)
            self.cameras.append((camera, matrix))
            if is_sheared:
                notes.append(f"camera: the shear of {camera.name} is left out")
        attribute_notes(self.parts.parts, notes)
        if scene.camera is not None and scene.camera.type == "CAMERA":
            clip_notes(scene, scene.camera, dict(self.cameras)[scene.camera], self.parts.parts, notes)
        self.materials, self.lights, self.film, self.lens, self.camera = tables_of(
            context, depsgraph, self.parts.used(), notes
        )


def tables_of(context, depsgraph, used: dict, notes: list) -> tuple:
    """Materials, lights, film and lens of the job, and the name of the camera. `used`: see `Parts.used`."""
    scene = context.scene
    materials = Materials()
    materials.survey(used, notes)
    lights = lights_of(depsgraph, notes)
    extended = [table["name"] for _, table in lights if has_extent(table)]
    if extended:
        notes.append(
            "lights with an extent are visible to the camera; in Cycles they are not, or light passes through them: "
            + ", ".join(extended)
        )
    if abs(scene.unit_settings.scale_length - 1.0) > 1e-6:
        notes.append(f"the unit scale {scene.unit_settings.scale_length:g}: a unit of Blender is a metre, as in Cycles")
    settings = getattr(scene, "cycles", None)
    if abs(getattr(settings, "film_exposure", 1.0) - 1.0) > 1e-6:
        notes.append("the exposure of the film is left out; a sensor has an exposure time")
    if scene.render.use_motion_blur:
        notes.append("motion blur is left out")
    if scene.render.film_transparent:
        notes.append("the transparent film is left out: the world is visible")
    if scene.render.use_multiview:
        notes.append("stereoscopy is left out: the camera itself is rendered")
    if scene.render.use_compositing and scene.use_nodes:
        notes.append("the compositor is left out")
    layers = [layer for layer in scene.view_layers if layer.use]
    if len(layers) > 1:
        notes.append(f"only the view layer {context.view_layer.name} is exported")
    if context.view_layer.material_override is not None:
        notes.append("the material override of the view layer is left out")
    film, lens, camera = camera_tables(scene, notes)
    environment_of(scene, "", False, notes)
    return materials, lights, film, lens, camera


class Copy:
    """A `with` block with a scene of its own in the window: one object for each mesh of the survey, and the cameras. Blender's
    glTF exporter then writes what a render sees."""

    def __init__(self, context, survey: Survey):
        self.context, self.survey = context, survey
        self.scene, self.objects, self.meshes = None, [], []
        # Names of objects and meshes by those of their copies.
        self.nodes: dict = {}
        self.mesh_names: dict = {}
        self.before = (context.window.scene, context.window.view_layer)

    def place(self, name: str, data, matrix) -> None:
        """Links a copy into the scene."""
        thing = bpy.data.objects.new("dunkelfeld", data)
        self.objects.append(thing)
        self.nodes[thing.name] = name
        thing.rotation_mode = "QUATERNION"
        thing.matrix_world = matrix
        self.scene.collection.objects.link(thing)

    def build(self) -> None:
        """Builds the scene."""
        from mathutils import Matrix

        parts = self.survey.parts
        self.scene = bpy.data.scenes.new("dunkelfeld")
        for shape, name in parts.shapes.values():
            if shape is not None:
                self.mesh_names[shape.copy.name] = name
        for name, _, shape, matrix in parts.parts:
            mesh, plain = shape.copy, Matrix.LocRotScale(*matrix.decompose())
            size = max(abs(c) for row in matrix.to_3x3() for c in row)
            if any(abs(a - b) > 1e-5 * size for r, q in zip(plain.to_3x3(), matrix.to_3x3()) for a, b in zip(r, q)):
                # A node of glTF has no shear.
                mesh = mesh.copy()
                self.meshes.append(mesh)
                self.mesh_names[mesh.name] = self.mesh_names[shape.copy.name]
                mesh.transform(matrix)
                if matrix.determinant() < 0.0:
                    mesh.flip_normals()
                matrix = Matrix()
            self.place(name, mesh, matrix)
        for camera, matrix in self.survey.cameras:
            self.place(camera.name, camera.data, matrix)
        self.context.window.scene = self.scene
        self.context.view_layer.update()

    def __enter__(self):
        try:
            self.build()
            return self
        except BaseException:
            self.remove()
            raise

    def __exit__(self, *_):
        self.remove()

    def remove(self) -> None:
        """Shows the scene of before again, and removes the copies."""
        self.context.window.scene, self.context.window.view_layer = self.before
        bpy.data.batch_remove(self.objects)
        bpy.data.batch_remove(self.meshes)
        if self.scene is not None:
            bpy.data.scenes.remove(self.scene)


def export(context, path: str, sensor: str = "imx250", exposure: str = "auto", time: str = "30s", spp: int = 0) -> list:
    """Writes the job `path` (.toml), the scene beside it (.glb), and the image of the world if there is one. Gives the list
    of all that could not be carried. `spp` above 0 replaces the limit of time. A setting that a job cannot have is a
    `ValueError` with its name."""
    check_settings(sensor, exposure, time, spp)
    stem = os.path.splitext(os.path.abspath(path))[0]
    scene = context.scene
    if context.active_object is not None and context.active_object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    survey = Survey(context, copies=True)
    materials, camera, notes = survey.materials, survey.camera, survey.notes
    try:
        with Copy(context, survey) as copy:
            materials.replace()
            result = bpy.ops.export_scene.gltf(
                filepath=stem + ".glb",
                export_format="GLB",
                export_yup=True,
                export_apply=True,
                export_cameras=True,
                export_lights=False,
                export_animations=False,
                export_skins=False,
                export_morph=False,
                export_tangents=False,
                export_extras=False,
                use_active_scene=True,
            )
    finally:
        materials.restore()
        survey.parts.remove()
    if "FINISHED" not in result:
        raise RuntimeError("Blender's glTF exporter did not finish")

    def change(document: dict) -> None:
        """The changes of the file of Blender's exporter."""
        rename_parts(document, copy.nodes, copy.mesh_names)
        change_materials(document, materials.plain, materials.renamed)

    change_glb(stem + ".glb", change)
    name = os.path.basename(stem)
    top: dict = {"scene": name + ".glb"} | ({"camera": camera} if camera else {})
    top["seed"] = int(getattr(getattr(scene, "cycles", None), "seed", 0))
    tables = [
        ("import", {"emissive_unit": "W/(m2 sr)"}),
        ("film", survey.film),
        ("lens", survey.lens),
        ("budget", {"spp": spp} if spp > 0 else {"time": time}),
        ("sensor", {"model": sensor} | ({"exposure": exposure} if sensor != "none" else {})),
        ("render", {"energy_compensation": True} if materials.is_compensated else {}),
        ("environment", environment_of(scene, stem, True, [])),
    ]
    text = job_text(top, tables + materials.tables + survey.lights, notes)
    with open(stem + ".toml", "w", encoding="utf-8", newline="\n") as file:
        file.write(text)
    return notes


if bpy is not None:
    import blf
    from bpy.props import IntProperty, StringProperty
    from bpy_extras.io_utils import ExportHelper

    def proposed(self, context, text):
        """Names of sensors that contain the text."""
        return [name for name in (*SENSORS, "none") if text.lower() in name]

    class DunkelfeldExport(bpy.types.Operator, ExportHelper):
        """Write the scene (.glb) and the job (.toml) of an image of an industrial camera"""

        bl_idname = "export_scene.dunkelfeld"
        bl_label = "Export Dunkelfeld"
        filename_ext = ".toml"
        filter_glob: StringProperty(default="*.toml", options={"HIDDEN"})
        sensor: StringProperty(
            name="Sensor",
            default="imx250",
            description="Preset of a sensor, a sensor file, or none for an image without a sensor",
            search=proposed,
            search_options={"SUGGESTION"},
        )
        exposure: StringProperty(
            name="Exposure", default="auto", description="Exposure time of the sensor, such as 5ms, or auto"
        )
        time: StringProperty(
            name="Render Time", default="30s", description="Time that the render takes, such as 30s or 5min"
        )
        spp: IntProperty(
            name="Samples",
            default=0,
            min=0,
            description="Samples per pixel, in place of the render time; 0: the render time counts",
        )
        notes: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

        def invoke(self, context, event):
            """Opens the file dialog with the list of the parts that cannot be carried."""
            try:
                self.notes = "\n".join(" ".join(note.split()) for note in Survey(context).notes)
            except ValueError as error:
                self.notes = str(error)
            return ExportHelper.invoke(self, context, event)

        def has_exposure(self):
            """Is the exposure a time or auto?"""
            return self.sensor == "none" or self.exposure == "auto" or is_time(self.exposure, LONGEST_EXPOSURE)

        def has_time(self):
            """Is the limit of the render a time or a number of samples?"""
            return self.spp > 0 or is_time(self.time)

        def draw(self, context):
            """The settings and the list."""
            layout = self.layout
            layout.use_property_split, layout.use_property_decorate = True, False
            rows = layout.column()
            row = rows.row()
            row.alert = self.sensor not in (*SENSORS, "none") and not self.sensor.endswith(".toml")
            row.prop(self, "sensor")
            row = rows.row()
            row.active, row.alert = self.sensor != "none", not self.has_exposure()
            row.prop(self, "exposure")
            row = rows.row()
            row.active, row.alert = self.spp == 0, not self.has_time()
            row.prop(self, "time")
            rows.prop(self, "spp")
            preferences = context.preferences
            scale = preferences.system.ui_scale
            blf.size(0, preferences.ui_styles[0].widget.points * scale)
            # Without the margins, the frame, and the icon before a note.
            width = context.region.width - MARGIN * scale
            lines = self.notes.split("\n") if self.notes else []
            box = layout.box()
            box.label(
                text="Not carried, or changed" if lines else "The whole scene is carried",
                icon="ERROR" if lines else "CHECKMARK",
            )
            for line in lines:
                column = box.column(align=True)
                column.scale_y = 0.8
                for i, part in enumerate(wrapped(line, width, lambda text: blf.dimensions(0, text)[0])):
                    column.label(text=part, icon="BLANK1" if i else "DOT")

        def execute(self, context):
            """Exports, and reports the list."""
            try:
                notes = export(context, self.filepath, self.sensor, self.exposure, self.time, self.spp)
            except (ValueError, RuntimeError, OSError) as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            for note in notes:
                self.report({"WARNING"}, "not carried, or changed: " + note)
            return {"FINISHED"}

    def menu(self, context):
        """The entry of File > Export."""
        self.layout.operator(DunkelfeldExport.bl_idname, text="Dunkelfeld (.toml)")

    def register():
        """Called by Blender."""
        bpy.utils.register_class(DunkelfeldExport)
        bpy.types.TOPBAR_MT_file_export.append(menu)

    def unregister():
        """Called by Blender."""
        bpy.types.TOPBAR_MT_file_export.remove(menu)
        bpy.utils.unregister_class(DunkelfeldExport)
