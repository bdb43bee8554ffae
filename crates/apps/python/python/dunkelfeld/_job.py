"""Entries of a job as classes: dictionaries with the keys of the tables of a job file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypedDict

from . import _native

if TYPE_CHECKING:
    from os import PathLike
    from typing import TypeAlias

    from numpy.typing import NDArray
    from typing_extensions import Unpack

    # A number in metres, seconds, watts or per metre, or a text with a unit: 0.012 or "12mm".
    Quantity: TypeAlias = float | str
    # An angle always has a unit: "30deg".
    Angle: TypeAlias = str
    # Three numbers or quantities, or an array of them.
    Triple: TypeAlias = Sequence[float | str] | NDArray[Any]
    # One number for all three channels, or three of them.
    Color: TypeAlias = float | str | Triple
    # A point, or the name of objects.
    Place: TypeAlias = str | Triple
    Matrix: TypeAlias = Sequence[Sequence[float]] | NDArray[Any]

__all__ = [
    "Camera",
    "CameraKeys",
    "LensKeys",
    "Light",
    "LightKeys",
    "Material",
    "MaterialKeys",
    "Object",
    "ObjectKeys",
]


class LensKeys(TypedDict, total=False):
    """Keys of `[lens]`, and of `lens` in a camera."""

    projection: Literal["perspective", "telecentric"]
    vertical_fov: Angle
    focal_length: Quantity
    field_height: Quantity
    f_number: float
    numerical_aperture: float
    transmission: float
    magnification: float
    focus_distance: Quantity
    blades: int
    blade_rotation: Angle
    distortion: Sequence[float] | NDArray[Any]
    principal_point: Sequence[float]
    filter: Mapping[str, Any]
    psf: str | Mapping[str, Any]
    glare: float
    vignetting: Literal["none", "cos4"]


class CameraKeys(TypedDict, total=False):
    """Keys of `[camera]` and `[[camera]]`."""

    name: str
    position: Triple
    look_at: Place
    up: Triple
    working_distance: Quantity
    direction: Triple
    R: Matrix
    t: Triple
    vertical_fov: Angle
    K: Matrix
    lens: LensKeys
    enabled: bool


class LightKeys(TypedDict, total=False):
    """Keys of `[[light]]`."""

    name: str
    kind: Literal["ring", "bar", "dome", "coaxial", "back", "panel", "spot", "point", "sun", "environment"]
    enabled: bool
    ies: str | PathLike[str]
    radiance: Color
    power: Quantity
    intensity: Color
    irradiance: Color
    scale: float
    wavelength: Quantity
    strobe: Quantity
    working_distance: Quantity
    diameter: Quantity
    inner_diameter: Quantity
    width: Quantity
    height: Quantity
    opening: Quantity
    tilt: Angle
    leds: int | Sequence[int]
    led_diameter: Quantity
    diffuser: bool
    lens_angle: Angle
    spread: Angle
    splitter: float
    cone_angle: Angle
    blend: float
    angle: Angle
    body: bool
    camera: str
    target: Place
    distance: Quantity
    direction: Triple
    elevation: Angle
    azimuth: Angle
    position: Triple
    aim: Triple
    up: Triple
    count: int


class _Named(TypedDict):
    name: str


class MaterialKeys(_Named, total=False):
    """Keys of `[[material]]`."""

    new: bool
    textures: bool
    base_color: Color
    alpha: float
    alpha_mode: Literal["opaque", "mask", "blend"]
    alpha_cutoff: float
    metallic: float
    roughness: float
    normal_scale: float
    emission: Color
    double_sided: bool
    unlit: bool
    ior: float
    specular: float
    specular_color: Color
    specular_tint: float
    transmission: float
    diffuse_transmission: float
    diffuse_transmission_color: Color
    solid: bool
    priority: int
    attenuation_color: Color
    attenuation_distance: Quantity
    scattering_albedo: Color
    absorption: Color
    scattering: Color
    scattering_anisotropy: float
    clearcoat: float
    clearcoat_roughness: float
    sheen_color: Color
    sheen_roughness: float
    anisotropy: float
    anisotropy_rotation: Angle
    grain: Triple | Mapping[str, Any]
    finish: str | Mapping[str, Any]
    height: Mapping[str, Any]


class ObjectKeys(_Named, total=False):
    """Keys of `[[object]]`."""

    kind: Literal["box", "plane", "cylinder", "sphere"]
    size: Sequence[Quantity]
    diameter: Quantity
    height: Quantity
    visible: bool
    translate: Triple
    rotate: Sequence[Angle] | Mapping[str, Any]
    scale: float | Sequence[float] | NDArray[Any]
    matrix: Sequence[float] | Matrix
    pivot: Place
    material: str
    edge_radius: Quantity
    instances: Sequence[Mapping[str, Any]]
    grid: Mapping[str, Any]
    velocity: Triple
    rotation: Mapping[str, Any]


class _Entry(dict[str, Any]):
    """A dictionary whose keys are those of one table of the job file."""

    _table: ClassVar[str]
    _required: ClassVar[tuple[str, ...]] = ()

    def _check(self) -> None:
        given = [key for key, value in self.items() if value is not None or key not in self._required]
        _native.check_job_keys(self._table, given, list(self._required))

    def __repr__(self) -> str:
        keys = ", ".join(f"{key}={value!r}" for key, value in self.items())
        return f"{type(self).__name__}({keys})"


class Camera(_Entry):
    """A `[camera]` or `[[camera]]` of a job; the keywords are its keys (`docs/job-file.md`).

    Lengths are numbers [m] or texts such as "12mm"; angles are texts such as "30deg". An unknown key raises
    `SettingError`.
    """

    _table = "camera"

    def __init__(self, **keys: Unpack[CameraKeys]) -> None:
        super().__init__(keys)
        self._check()


class Light(_Entry):
    """A `[[light]]` of a job; the keywords are its keys (`docs/job-file.md`).

    With `kind` it is a new lamp, without it a change of the lights with its name. Radiance is in W/(m2 sr), power in
    W, intensity in W/sr, irradiance in W/m2. An unknown key raises `SettingError`.
    """

    _table = "light"

    def __init__(self, **keys: Unpack[LightKeys]) -> None:
        super().__init__(keys)
        self._check()


class Material(_Entry):
    """A `[[material]]` of a job; the keywords are its keys (`docs/job-file.md`).

    `name` is required. With `new=True` it is a new material, otherwise a change of the materials with its name. Colours
    are linear Rec. 709. An unknown key raises `SettingError`.
    """

    _table = "material"
    _required = ("name",)

    def __init__(self, **keys: Unpack[MaterialKeys]) -> None:
        super().__init__(keys)
        self._check()


class Object(_Entry):
    """An `[[object]]` of a job; the keywords are its keys (`docs/job-file.md`).

    `name` is required. With `kind` it is a new object, otherwise a change of the objects with its name. Lengths are
    numbers [m] or texts such as "12mm". `matrix` is a matrix of 4 x 4 numbers, or its 16 numbers row by row. An unknown
    key raises `SettingError`.
    """

    _table = "object"
    _required = ("name",)

    def __init__(self, **keys: Unpack[ObjectKeys]) -> None:
        super().__init__(keys)
        rows: Any = keys.get("matrix")
        if (
            hasattr(rows, "__len__")
            and len(rows) == 4
            and all(hasattr(row, "__len__") and len(row) == 4 for row in rows)
        ):
            self["matrix"] = [value for row in rows for value in row]
        self._check()
