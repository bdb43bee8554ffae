//! Points, vectors and scales of a job: lengths with a unit, directions, and places that an object's name gives.

use super::patterns::{matches, unique};
use crate::error::InputError;
use crate::names::suggestion;
use crate::quantity::{Angle, Length};
use dunkelfeld_geometry::{DAffine3, DMat3, DQuat, DVec3};
use dunkelfeld_radiometry::Number;
use dunkelfeld_scene::{Instance, SceneBuilder};
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error, IntoDeserializer, SeqAccess, Visitor};
use std::fmt;

/// Largest coordinate \[m\]. Squared distances remain far inside the range of f32.
const FARTHEST: f64 = 1e9;
/// Range of the factors of a scale.
const SCALES: std::ops::RangeInclusive<f64> = 1e-12..=1e12;

/// A point in the world: `[x, y, z]`, or the name or pattern of objects. Then the point is the centre of their common
/// bounds.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// Coordinates \[m\].
    Point(DVec3),
    /// Name of objects, or a pattern with `*` and `?`.
    Object(String),
}

impl Place {
    /// The point \[m\] in the world.
    ///
    /// # Errors
    /// If no object has the name, or the objects have no vertices: an error without a place.
    pub fn resolve(&self, scene: &SceneBuilder) -> Result<DVec3, InputError> {
        match self {
            Self::Point(point) => Ok(*point),
            Self::Object(name) => bounds_of_objects(name, scene).map(|[low, high]| 0.5 * (low + high)),
        }
    }
}

impl<'de> Deserialize<'de> for Place {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct PlaceVisitor;
        impl<'de> Visitor<'de> for PlaceVisitor {
            type Value = Place;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a point such as [0, 0, \"200mm\"], or the name of an object")
            }
            fn visit_str<E: Error>(self, name: &str) -> Result<Place, E> {
                if name.is_empty() {
                    return Err(E::custom("the name of the object is empty; write its name, or a point [x, y, z]"));
                }
                Ok(Place::Object(name.to_string()))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Place, A::Error> {
                point(SeqAccessDeserializer::new(seq)).map(Place::Point)
            }
        }
        d.deserialize_any(PlaceVisitor)
    }
}

/// Common bounds `[low, high]` \[m\] in the world of all objects whose name matches.
///
/// # Errors
/// As [`Place::resolve`].
pub(super) fn bounds_of_objects(name: &str, scene: &SceneBuilder) -> Result<[DVec3; 2], InputError> {
    let named: Vec<&Instance> = scene.instances.iter().filter(|n| matches(name, &n.name)).collect();
    if named.is_empty() {
        return Err(no_object(name, scene));
    }
    let all = named.iter().filter_map(|instance| scene.bounds_of(instance));
    all.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]).ok_or_else(|| {
        let problem = format!("the object \"{name}\" has no vertices");
        InputError::of_key("", problem, "name an object with a mesh, or write a point")
    })
}

/// The error of a name that no object has, without a place.
pub(super) fn no_object(name: &str, scene: &SceneBuilder) -> InputError {
    let known = unique(scene.instances.iter().map(|n| n.name.as_str()));
    InputError::of_key("", format!("the scene has no object named \"{name}\""), suggestion(name, "objects", &known))
}

/// Three lengths \[m\], each a number of metres or a text with a unit.
pub(super) fn point<'de, D: Deserializer<'de>>(d: D) -> Result<DVec3, D::Error> {
    let values = three::<Length, D>(d, "three lengths such as [0, 0, \"200mm\"]")?.map(f64::from);
    in_space(values)
}

/// As [`point`], for a key that may be absent.
pub(super) fn optional_point<'de, D: Deserializer<'de>>(d: D) -> Result<Option<DVec3>, D::Error> {
    point(d).map(Some)
}

fn in_space<E: Error>(values: [f64; 3]) -> Result<DVec3, E> {
    match values.into_iter().find(|v| !(-FARTHEST..=FARTHEST).contains(v)) {
        Some(v) => Err(E::custom(format!("{} m is out of range; write lengths from -1e9 m to 1e9 m", Number(v)))),
        None => Ok(DVec3::from_array(values)),
    }
}

/// Edges \[m\], each above zero.
pub(super) fn edges<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<[f64; N], D::Error> {
    let edges: Vec<f64> = Vec::<Length>::deserialize(d)?.into_iter().map(f64::from).collect();
    let count = edges.len();
    let edges = <[f64; N]>::try_from(edges).map_err(|_| {
        let form = if N == 2 { "[x, z]" } else { "[x, y, z]" };
        D::Error::custom(format!("this shape has {N} edges, and {count} are given; write {form}"))
    })?;
    match edges.iter().find(|v| !(1e-9..=FARTHEST).contains(*v)) {
        Some(v) => Err(D::Error::custom(format!("{} m is not a size; write lengths above zero", Number(*v)))),
        None => Ok(edges),
    }
}

/// A direction of unit length from three plain numbers of any length above zero.
pub(super) fn direction<'de, D: Deserializer<'de>>(d: D) -> Result<Option<DVec3>, D::Error> {
    let v = DVec3::from_array(three::<f64, D>(d, "three numbers such as [0, 1, 0]")?);
    let largest = v.abs().max_element();
    match (v / largest).try_normalize() {
        Some(unit) if largest.is_finite() => Ok(Some(unit)),
        _ => Err(D::Error::custom(
            "this is not a direction; write three numbers that are not all zero, such as [0, 1, 0]",
        )),
    }
}

/// Factors of a scale along x, y and z from three numbers or one. Zero and negative ones are refused: a flat object has
/// no inverse, and a mirrored one is a different part. A `matrix` may mirror.
pub(super) fn scale<'de, D: Deserializer<'de>>(d: D) -> Result<Option<DVec3>, D::Error> {
    let values = one_or_three::<f64, D>(d, "a factor above zero, or three of them [x, y, z]")?;
    match values.into_iter().find(|v| !SCALES.contains(v)) {
        Some(v) => {
            let help = "write factors from 1e-12 to 1e12, or mirror the object by `matrix`";
            Err(D::Error::custom(format!("{} is not a factor of a scale; {help}", Number(v))))
        }
        None => Ok(Some(DVec3::from_array(values))),
    }
}

/// Sixteen numbers, row by row: an affine map that can be inverted. The fourth column is the translation \[m\].
pub(super) fn matrix<'de, D: Deserializer<'de>>(d: D) -> Result<Option<DAffine3>, D::Error> {
    let values = Vec::<f64>::deserialize(d)?;
    let Ok([a, b, c, x, e, f, g, y, i, j, k, z, l, m, n, w]) = <[f64; 16]>::try_from(values.as_slice()) else {
        let problem = format!("a matrix has 16 numbers, row by row, and this has {}", values.len());
        return Err(D::Error::custom(format!("{problem}; write four rows of four numbers in one list")));
    };
    if [l, m, n, w] != [0.0, 0.0, 0.0, 1.0] {
        return Err(D::Error::custom(
            "the last row of the matrix is not 0, 0, 0, 1; write the matrix row by row, with the translation in the fourth column",
        ));
    }
    let linear = DMat3::from_cols_array(&[a, e, i, b, f, j, c, g, k]);
    let map = DAffine3::from_mat3_translation(linear, in_space([x, y, z])?);
    match dunkelfeld_geometry::Transform::new(map) {
        Ok(_) => Ok(Some(map)),
        Err(e) => Err(D::Error::custom(format!("{e}; write a matrix that can be inverted"))),
    }
}

/// A rotation: `{ axis = [x, y, z], angle = "30deg" }`, or three angles about x, y and z, applied in this order about
/// the fixed axes of the world.
pub(super) fn rotation<'de, D: Deserializer<'de>>(d: D) -> Result<Option<DQuat>, D::Error> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct AxisAngle {
        #[serde(deserialize_with = "direction")]
        axis: Option<DVec3>,
        angle: Angle,
    }
    struct RotationVisitor;
    impl<'de> Visitor<'de> for RotationVisitor {
        type Value = DQuat;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("{ axis = [x, y, z], angle = \"30deg\" }, or three angles about x, y and z")
        }
        fn visit_map<A: serde::de::MapAccess<'de>>(self, map: A) -> Result<DQuat, A::Error> {
            let AxisAngle { axis, angle } = AxisAngle::deserialize(MapAccessDeserializer::new(map))?;
            Ok(DQuat::from_axis_angle(axis.unwrap_or(DVec3::Y), finite(angle.0)?))
        }
        fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<DQuat, A::Error> {
            let what = "three angles about x, y and z, such as [\"0deg\", \"90deg\", \"0deg\"]";
            let [x, y, z] = three::<Turn, _>(SeqAccessDeserializer::new(seq), what)?.map(|Turn(angle)| angle);
            let (x, y, z) = (finite(x)?, finite(y)?, finite(z)?);
            Ok(DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x))
        }
    }
    d.deserialize_any(RotationVisitor).map(Some)
}

/// An angle \[rad\] of a rotation. A zero needs no unit.
struct Turn(f64);

impl<'de> Deserialize<'de> for Turn {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct TurnVisitor;
        impl Visitor<'_> for TurnVisitor {
            type Value = Turn;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an angle as \"30deg\", or 0")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Turn, E> {
                text.parse::<Angle>().map(|angle| Turn(angle.0)).map_err(E::custom)
            }
            fn visit_i64<E: Error>(self, v: i64) -> Result<Turn, E> {
                self.visit_f64(v as f64)
            }
            fn visit_f64<E: Error>(self, v: f64) -> Result<Turn, E> {
                if v == 0.0 {
                    return Ok(Turn(v));
                }
                Err(E::custom(format!("{} lacks a unit; write an angle as \"30deg\"", Number(v))))
            }
        }
        d.deserialize_any(TurnVisitor)
    }
}

fn finite<E: Error>(angle: f64) -> Result<f64, E> {
    if angle.abs() <= 1e6 {
        return Ok(angle);
    }
    Err(E::custom(format!("{} rad is out of range; write an angle such as \"30deg\"", Number(angle))))
}

/// Exactly three values.
pub(super) fn three<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    d: D,
    what: &'static str,
) -> Result<[T; 3], D::Error> {
    struct Three<T>(&'static str, std::marker::PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Three<T> {
        type Value = [T; 3];
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }
        fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<[T; 3], A::Error> {
            let values = Vec::deserialize(SeqAccessDeserializer::new(seq))?;
            let wrong = |_| A::Error::custom(format!("this needs exactly three values; write {}", self.0));
            values.try_into().map_err(wrong)
        }
    }
    d.deserialize_seq(Three(what, std::marker::PhantomData))
}

/// Three values, or one for all three.
pub(super) fn one_or_three<'de, T: Deserialize<'de> + Into<f64>, D: Deserializer<'de>>(
    d: D,
    what: &'static str,
) -> Result<[f64; 3], D::Error> {
    struct OneOrThree<T>(&'static str, std::marker::PhantomData<T>);
    impl<'de, T: Deserialize<'de> + Into<f64>> Visitor<'de> for OneOrThree<T> {
        type Value = [f64; 3];
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }
        fn visit_i64<E: Error>(self, v: i64) -> Result<[f64; 3], E> {
            T::deserialize(v.into_deserializer()).map(|v| [v.into(); 3])
        }
        fn visit_f64<E: Error>(self, v: f64) -> Result<[f64; 3], E> {
            T::deserialize(v.into_deserializer()).map(|v| [v.into(); 3])
        }
        fn visit_str<E: Error>(self, v: &str) -> Result<[f64; 3], E> {
            T::deserialize(v.into_deserializer()).map(|v| [v.into(); 3])
        }
        fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<[f64; 3], A::Error> {
            three::<T, _>(SeqAccessDeserializer::new(seq), self.0).map(|values| values.map(Into::into))
        }
    }
    d.deserialize_any(OneOrThree::<T>(what, std::marker::PhantomData))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::{Mesh, Vec3};

    #[derive(Debug, Deserialize)]
    struct Keys {
        place: Option<Place>,
        #[serde(default, deserialize_with = "optional_point")]
        point: Option<DVec3>,
        #[serde(default, deserialize_with = "direction")]
        direction: Option<DVec3>,
        #[serde(default, deserialize_with = "scale")]
        scale: Option<DVec3>,
        #[serde(default, deserialize_with = "edges")]
        size: [f64; 3],
        #[serde(default, deserialize_with = "matrix")]
        matrix: Option<DAffine3>,
        #[serde(default, deserialize_with = "rotation")]
        rotate: Option<DQuat>,
    }

    fn keys(text: &str) -> Keys {
        toml::from_str(text).unwrap_or_else(|e| panic!("{text}: {e}"))
    }

    #[test]
    fn values_are_read_with_their_units() {
        assert_eq!(keys("place = [0, 1.5, \"20mm\"]").place, Some(Place::Point(DVec3::new(0.0, 1.5, 0.02))));
        assert_eq!(keys("place = \"lid*\"").place, Some(Place::Object("lid*".into())));
        assert_eq!(keys("point = [\"-1cm\", 0, 0]").point, Some(DVec3::new(-0.01, 0.0, 0.0)));
        assert_eq!(keys("direction = [0, -3, 0]").direction, Some(DVec3::NEG_Y));
        assert_eq!(keys("scale = 2").scale, Some(DVec3::splat(2.0)));
        assert_eq!(keys("scale = [1, 2.5, 3]").scale, Some(DVec3::new(1.0, 2.5, 3.0)));
        assert_eq!(keys("size = [\"1mm\", 2, 3]").size, [0.001, 2.0, 3.0]);
        let matrix = keys("matrix = [0,-1,0,5, 1,0,0,6, 0,0,1,7, 0,0,0,1]").matrix.expect("a matrix");
        assert_eq!(matrix.transform_point3(DVec3::X), DVec3::new(5.0, 7.0, 7.0));
        // About x first, then about y: +z goes to -y, which the second rotation keeps; the other order differs.
        let turned = keys("rotate = [\"90deg\", \"90deg\", \"0deg\"]").rotate.expect("a rotation") * DVec3::Z;
        assert!(turned.distance(DVec3::NEG_Y) < 1e-12, "{turned}");
        let turned = keys("rotate = { axis = [0, 2, 0], angle = \"90deg\" }").rotate.expect("a rotation") * DVec3::Z;
        assert!(turned.distance(DVec3::X) < 1e-12, "{turned}");
    }

    #[test]
    fn a_name_gives_the_centre_of_the_common_bounds() {
        let mut scene = SceneBuilder::default();
        let mesh =
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
        scene.add_object("lid 1", mesh.clone(), 0);
        let second = scene.add_object("lid 2", mesh, 0);
        scene.instances[second].to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, 4.0));
        assert_eq!(Place::Object("lid *".into()).resolve(&scene), Ok(DVec3::new(0.5, 0.5, 2.0)));
    }
}
