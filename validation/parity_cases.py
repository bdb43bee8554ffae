"""The cases of `parity.py`: what is rendered by both renderers, grouped as in the table of docs/research/parity.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Iterator

import numpy as np

from parity_scene import Camera, Light, Material, Medium, Scene, Shape, Textures, ball, box, quad

GREY = Material(base_color=(0.5, 0.5, 0.5), roughness=0.8)
WALL = Material(base_color=(0.7, 0.35, 0.2), roughness=0.9)
LAMP = Material(kind="black", radiance=(6.0, 5.5, 4.5))
ORANGE = (0.8, 0.4, 0.15)
PLASTIC = Material(base_color=ORANGE, roughness=0.4)
METAL = Material(base_color=(0.9, 0.7, 0.4), metallic=1.0, roughness=0.4)
GLASS = Material(kind="dielectric", base_color=(1.0, 1.0, 1.0), roughness=0.0)
SKY = (0.35, 0.4, 0.5)
# Of every case without a number of its own: their scatter gives the variance.
BATCHES = 32


@dataclass(frozen=True)
class File:
    """One of our scenes that are shipped, seen by a camera whose field is narrower by `zoom`; `faceted` if no normal is to
    be interpolated."""

    path: Path
    zoom: float
    faceted: bool = False


@dataclass(frozen=True)
class Case:
    """A scene with a name; `spp` for both renderers, in all `batches` together."""

    group: str
    name: str
    scene: Scene | File
    spp: int = 2048
    batches: int = BATCHES

    @property
    def batch_spp(self) -> int:
        """Samples per pixel of a batch."""
        assert self.spp % self.batches == 0, f"{self.name}: its batches differ in size"
        return self.spp // self.batches


def stage(name: str, subject: Shape, material: Material, **more: object) -> Scene:
    """A subject on a grey floor before a reddish wall, under a square lamp and a bluish sky."""
    shapes = [
        subject,
        quad("floor", "floor", (-1.5, 0.0, 1.5), (3.0, 0.0, 0.0), (0.0, 0.0, -3.0)),
        quad("wall", "wall", (-1.5, 0.0, -0.8), (3.0, 0.0, 0.0), (0.0, 2.0, 0.0)),
        quad("lamp", "lamp", (0.1, 1.6, 0.2), (0.9, 0.0, 0.0), (0.0, 0.0, 0.9)),
    ]
    # The lamp shines down.
    materials = {subject.material: material, "floor": GREY, "wall": WALL, "lamp": LAMP}
    scene = Scene(name, shapes, materials, environment=SKY)
    for key, value in more.items():
        setattr(scene, key, value)
    return scene


def merged(shapes: list[Shape]) -> Shape:
    """Flat shapes of one material as a single mesh."""
    first = np.cumsum([0] + [len(s.positions) for s in shapes[:-1]])
    triangles = np.concatenate([s.triangles + offset for s, offset in zip(shapes, first)])
    return Shape(shapes[0].name, np.concatenate([s.positions for s in shapes]), triangles, shapes[0].material)


def on_ball(material: Material, **more: object) -> Scene:
    """The usual subject: a ball with 320 flat facets."""
    return stage("ball", ball("subject", "subject", (0.0, 0.42, 0.0), 0.4), material, **more)


def in_box(material: Material, **more: object) -> Scene:
    """A turned cube of 0.5 m, hovering."""
    return stage("box", box("subject", "subject", (0.0, 0.4, 0.0), (0.5, 0.5, 0.5), 0.6), material, **more)


def principled() -> Iterator[Case]:
    """Each parameter of the principled BSDF on a grid, alone and together."""
    case = lambda name, material: Case("principled", name, on_ball(material))
    yield case("base-color-black", replace(PLASTIC, base_color=(0.0, 0.0, 0.0)))
    yield case("base-color-white", replace(PLASTIC, base_color=(1.0, 1.0, 1.0)))
    yield case("base-color-orange", PLASTIC)
    for value in (0.0, 0.1, 0.25, 0.7, 1.0):
        yield case(f"roughness-{value:g}", replace(PLASTIC, roughness=value))
    for value in (0.0, 0.1, 0.25, 0.7, 1.0):
        yield case(f"metal-roughness-{value:g}", replace(METAL, roughness=value))
    for value in (0.25, 0.5, 0.75, 1.0):
        yield case(f"metallic-{value:g}", replace(METAL, metallic=value))
    for value in (0.3, 0.6, 0.9, 1.0):
        yield case(f"anisotropic-{value:g}", replace(METAL, anisotropic=value))
    for value in (1.05, 1.3, 1.8, 2.5):
        yield case(f"eta-{value:g}", replace(PLASTIC, eta=value))
    for value in (0.5, 1.0):
        yield case(f"spec-tint-{value:g}", replace(PLASTIC, spec_tint=value, eta=1.8))
    for value in (0.25, 0.5, 0.75, 1.0):
        yield case(f"spec-trans-{value:g}", replace(PLASTIC, spec_trans=value))
    yield case("spec-trans-eta-1.2", replace(PLASTIC, spec_trans=0.8, eta=1.2, roughness=0.2))
    yield case("spec-trans-metallic-0.5", replace(PLASTIC, spec_trans=0.8, metallic=0.5))
    yield case("spec-trans-tint-1", replace(PLASTIC, spec_trans=0.8, spec_tint=1.0))
    for value in (0.5, 1.0):
        yield case(f"sheen-{value:g}", replace(PLASTIC, sheen=value))
    for value in (0.5, 1.0):
        yield case(f"sheen-tint-{value:g}", replace(PLASTIC, sheen=0.5, sheen_tint=value))
    for value in (0.5, 1.0):
        yield case(f"clearcoat-{value:g}", replace(PLASTIC, clearcoat=value, clearcoat_gloss=0.5))
    for value in (0.0, 0.5, 1.0):
        yield case(f"clearcoat-gloss-{value:g}", replace(PLASTIC, clearcoat=1.0, clearcoat_gloss=value))
    mixture = Material(
        base_color=ORANGE,
        metallic=0.3,
        roughness=0.3,
        anisotropic=0.5,
        eta=1.4,
        spec_tint=0.3,
        sheen=0.4,
        sheen_tint=0.3,
        clearcoat=0.6,
        clearcoat_gloss=0.7,
    )
    yield case("everything", mixture)
    yield case("everything-transmitting", replace(mixture, spec_trans=0.5))


def clear() -> Iterator[Case]:
    """Clear solids and sheets."""
    case = lambda name, scene: Case("clear", name, scene, 4096)
    yield case("glass-ball", on_ball(GLASS))
    for eta in (1.1, 2.4):
        yield case(f"glass-box-eta-{eta:g}", in_box(replace(GLASS, eta=eta)))
    yield case("glass-box-tinted", in_box(replace(GLASS, base_color=(0.9, 0.6, 0.4))))
    for roughness in (0.2, 0.5, 0.8):
        yield case(f"rough-glass-ball-{roughness:g}", on_ball(replace(GLASS, roughness=roughness)))
    yield case("rough-glass-box-eta-1.1", in_box(replace(GLASS, roughness=0.4, eta=1.1)))
    yield case("rough-glass-box-eta-2.4", in_box(replace(GLASS, roughness=0.4, eta=2.4)))
    yield case("rough-glass-box-tinted", in_box(replace(GLASS, roughness=0.5, base_color=(0.9, 0.6, 0.4))))
    sheet = quad("subject", "subject", (-0.5, 0.1, 0.1), (1.0, 0.0, 0.0), (0.0, 0.7, -0.35))
    thin = Material(kind="thin", base_color=(1.0, 1.0, 1.0), roughness=0.0)
    yield case("thin-sheet", stage("sheet", sheet, thin))
    yield case("thin-sheet-eta-2.4-tinted", stage("sheet", sheet, replace(thin, eta=2.4, base_color=(0.9, 0.6, 0.4))))


def media() -> Iterator[Case]:
    """What fills a solid."""
    case = lambda name, scene, spp=2048: Case("media", name, scene, spp)
    absorbing = Medium(absorption=(0.5, 2.0, 6.0))
    yield case("absorbing-box", in_box(replace(GLASS, medium=absorbing)), 4096)
    yield case("absorbing-rough-ball", on_ball(replace(GLASS, roughness=0.3, medium=absorbing)), 4096)
    milk = Medium(absorption=(0.2, 0.6, 2.0), scattering=(6.0, 6.0, 6.0))
    yield case("scattering-box", in_box(replace(GLASS, medium=milk)))
    for g in (-0.5, 0.7):
        turned = replace(milk, scattering=(4.0, 8.0, 12.0), anisotropy=g)
        yield case(f"scattering-box-g-{g:g}", in_box(replace(GLASS, medium=turned)), 4096 if g < 0.0 else 2048)
    yield case("scattering-rough-ball", on_ball(replace(GLASS, roughness=0.4, medium=milk)), 4096)
    yield case("cloud", in_box(replace(GLASS, eta=1.0, medium=Medium((0.0, 0.0, 0.0), (5.0, 5.0, 5.0)))))
    thick = Medium((0.1, 1.0, 4.0), (20.0, 10.0, 5.0), 0.6)
    yield case("cloud-coloured-forward", in_box(replace(GLASS, eta=1.0, medium=thick)))
    frosted = replace(PLASTIC, spec_trans=0.8, base_color=(0.9, 0.9, 0.9), medium=milk)
    yield case("scattering-behind-a-principled-face", in_box(frosted))


def lights() -> Iterator[Case]:
    """Each kind of light, one at a time, with stated exceptions."""

    def case(name: str, material: Material = PLASTIC, spp: int = 2048, **more: object) -> Case:
        scene = stage(name, ball("subject", "subject", (0.0, 0.42, 0.0), 0.4, rounds=1), material)
        scene.environment = None
        for key, value in more.items():
            setattr(scene, key, value)
        return Case("lights", name, scene, spp)

    def without_lamp(made: Case) -> Case:
        made.scene.shapes = [s for s in made.scene.shapes if s.name != "lamp"]
        del made.scene.materials["lamp"]
        return made

    yield case("rectangle-light", METAL, 4096)
    triangle = case("triangle-light")
    lamp = triangle.scene.shapes[-1]
    lamp.triangles, lamp.positions, lamp.uvs = lamp.triangles[:1], lamp.positions[:3], None
    yield triangle
    near = case("near-light", replace(METAL, roughness=0.2), 8192)
    near.scene.shapes[-1] = quad("lamp", "lamp", (0.45, 0.15, 0.3), (0.0, 0.0, -0.6), (0.0, 0.5, 0.0))
    yield near
    sides = case("two-sided-light")
    sides.scene.materials["lamp"] = replace(LAMP, two_sided_light=True)
    sides.scene.shapes[-1] = quad("lamp", "lamp", (-0.8, 0.3, 0.5), (0.4, 0.0, 0.2), (0.0, 0.5, 0.0))
    yield sides
    many = case("many-lights")
    corners = [(-1.1 + 0.25 * i, 1.5, -0.6 + 0.2 * j) for i in range(10) for j in range(9)]
    lamps = [quad("lamp", "lamp", corner, (0.08, 0.0, 0.0), (0.0, 0.0, 0.08)) for corner in corners]
    many.scene.shapes[-1] = merged(lamps)
    many.scene.materials["lamp"] = replace(LAMP, radiance=(12.0, 11.0, 9.0))
    yield many
    beam = lambda kind, **more: Light(kind, (0.8, 1.5, 1.0), (0.0, 0.3, 0.0), (6.0, 5.0, 4.0), **more)
    yield without_lamp(case("point-light", lights=[beam("point")]))
    yield without_lamp(case("spot-light-hard", lights=[beam("spot", inner=0.2, outer=0.2)]))
    yield without_lamp(case("spot-light-soft", lights=[beam("spot", inner=0.05, outer=0.3)]))
    yield without_lamp(case("directional-light", lights=[beam("directional")]))
    yield case("all-kinds-of-light", lights=[beam("point"), beam("directional")], environment=SKY)
    yield without_lamp(case("constant-sky", METAL, environment=SKY))
    sky = np.random.default_rng(5).uniform(0.05, 0.6, (8, 16, 3))
    sky[2, 11] = (60.0, 50.0, 40.0)
    sky[3, 4] = (5.0, 10.0, 15.0)
    yield without_lamp(case("environment-map", environment=sky))
    yield without_lamp(case("environment-map-metal", replace(METAL, roughness=0.2), 8192, environment=sky))


def cameras() -> Iterator[Case]:
    """Projections."""
    parallel = Camera(half_height=0.55)
    yield Case("cameras", "orthographic", replace(on_ball(PLASTIC, camera=parallel), stage="orthographic"))
    for name, focus in (("thin-lens-near", 1.45), ("thin-lens-far", 2.6)):
        lens = Camera(aperture=0.05, focus=focus)
        yield Case("cameras", name, on_ball(replace(METAL, roughness=0.2), camera=lens), 4096)
    # Far enough off the middle that either sign, or both axes exchanged, would show the wrong part of the stage.
    yield Case("cameras", "principal-point", on_ball(PLASTIC, camera=Camera(principal_point=(0.3, -0.2))))


def surfaces() -> Iterator[Case]:
    """Coverage, textures and normals."""
    for name, material in (("coverage-0.3", PLASTIC), ("coverage-0.7-metal", METAL)):
        yield Case("surfaces", name, on_ball(replace(material, opacity=float(name.split("-")[1]))), 4096)
    shallow = ball("subject", "subject", (0.0, 0.42, 0.0), 0.4, smooth=True, rounds=3)
    yield Case("surfaces", "smooth-normals", stage("smooth", shallow, replace(PLASTIC, roughness=0.5)))
    board = quad("subject", "subject", (-0.45, 0.05, 0.25), (0.9, 0.0, 0.0), (0.0, 0.7, -0.45))
    rng = np.random.default_rng(7)
    color = rng.integers(20, 256, (8, 8, 3), dtype=np.uint8)
    x, y = np.meshgrid(2.0 * math.pi * (np.arange(32) + 0.5) / 32, 2.0 * math.pi * (np.arange(32) + 0.5) / 32)
    # Waves whose normals lean by up to 20 degrees.
    slopes = np.stack([-0.25 * np.cos(2.0 * x), 0.25 * np.sin(y), np.ones_like(x)], axis=-1)
    slopes /= np.linalg.norm(slopes, axis=-1, keepdims=True)
    normals = np.round(255.0 * (0.5 + 0.5 * slopes)).astype(np.uint8)
    for name, textures in (
        ("textured", Textures(color=color)),
        ("normal-mapped", Textures(normals=normals)),
        ("textured-and-normal-mapped", Textures(color, normals)),
    ):
        # A texture is multiplied by the base colour, which is white here.
        scene = stage(name, board, replace(PLASTIC, base_color=(1.0, 1.0, 1.0)), textures={"subject": textures})
        yield Case("surfaces", name, scene)


def inspection() -> Iterator[Case]:
    """The scenes of the paper, the moulded cover with its faces' own normals; `compare_inspection.py` looks at their parts one by
    one, and `furnace.py` at what interpolated normals do. Under the covers Mitsuba finds the lights by chance: the mean would
    be known to 0.15 % at some 200 000 spp. With more batches, renders go on where they were."""
    folder = Path(__file__).resolve().parent.parent / "scenes" / "inspection"
    case = lambda name, file, batches: Case("inspection", name, file, 64 * batches, batches)
    yield case("inspection-open", File(folder / "inspection-open.glb", 1.0), 128)
    yield case("inspection-flat", File(folder / "inspection-flat.glb", 1.0), 64)
    yield case("inspection-faceted", File(folder / "inspection.glb", 1.0, faceted=True), 64)


def all_cases() -> list[Case]:
    """Every case, in the order of the table."""
    found = [*principled(), *clear(), *media(), *lights(), *cameras(), *surfaces(), *inspection()]
    names = [case.name for case in found]
    assert len(set(names)) == len(names), "two cases have one name"
    return found
