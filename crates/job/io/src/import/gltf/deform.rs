//! The default pose: morph targets at their default weights, skins at their joints' rest position.

use super::accessor::{Accessors, Stored};
use super::primitive::attribute;
use crate::import::warnings::Warnings;
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3, Mesh, Vec3};
use gltf::json::mesh::{MorphTarget, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Index, Skin};

/// The deformation of a mesh.
#[derive(Clone, Copy, Default)]
pub(super) struct Deformation<'a> {
    /// Weight of each morph target.
    pub(super) weights: &'a [f32],
    /// The skin's joints.
    pub(super) skin: Option<&'a Pose>,
}

/// A skin in its default pose.
pub(super) struct Pose {
    /// Mesh space to a space parallel to the world's, with its origin at `origin`. The origin is close to the skin, so
    /// that f32 positions keep their precision far from the origin of the world.
    joints: Vec<DAffine3>,
    /// World position of that origin: the first joint.
    pub(super) origin: DVec3,
}

impl Pose {
    /// The joint matrices (glTF 2.0, section 3.7.3): global transform of the joint times its inverse bind matrix.
    pub(super) fn new(accessors: &Accessors<'_>, skin: &Skin, to_world: &[DAffine3]) -> Result<Self, String> {
        let count = skin.joints.len();
        let binds = match skin.inverse_bind_matrices {
            None => vec![DAffine3::IDENTITY; count],
            Some(index) => accessors.vectors::<16>(index.value(), Stored::Float)?.iter().map(affine).collect(),
        };
        if binds.len() < count {
            return Err(format!("there are {} inverse bind matrices for {count} joints", binds.len()));
        }
        let globals: Result<Vec<_>, String> = (skin.joints.iter())
            .map(|j| to_world.get(j.value()).copied().ok_or_else(|| format!("its joint {j} does not exist")))
            .collect();
        let globals = globals?;
        let origin = globals.first().ok_or("it has no joints")?.translation;
        let near = DAffine3::from_translation(-origin);
        let joints: Vec<_> = globals.iter().zip(binds).map(|(global, bind)| near * *global * bind).collect();
        if !joints.iter().all(DAffine3::is_finite) {
            return Err("a joint's transform is not finite".into());
        }
        Ok(Self { joints, origin })
    }
}

/// Applies morph targets, then the skin. Without usable joints or targets the mesh remains as it is, with a warning.
pub(super) fn deform(
    mesh: &mut Mesh,
    accessors: &Accessors<'_>,
    primitive: &Primitive,
    deformation: &Deformation<'_>,
    place: &str,
    warnings: &mut Warnings,
) {
    let morph_targets = primitive.targets.as_deref().unwrap_or_default();
    let (targets, weights) = (morph_targets.len(), deformation.weights.len());
    if weights > 0 && weights != targets {
        let consequence =
            if weights > targets { "the last ones are ignored" } else { "the last targets have weight 0" };
        warnings.push(place, format!("there are {weights} weights for {targets} morph targets; {consequence}"));
    }
    warn_half_skins(primitive, place, warnings);
    for (i, (target, weight)) in morph_targets.iter().zip(deformation.weights).enumerate() {
        if *weight != 0.0
            && let Err(e) = morph(mesh, accessors, target, *weight)
        {
            warnings.push(place, format!("morph target {i} cannot be used and is left out: {e}"));
        }
    }
    if let Some(pose) = deformation.skin
        && let Err(e) = skin(mesh, accessors, primitive, pose)
    {
        warnings.push(place, format!("the skin cannot be used, the mesh stays in its bind pose: {e}"));
    }
}

/// Warns of joints without weights and weights without joints. Neither changes a vertex.
fn warn_half_skins(primitive: &Primitive, place: &str, warnings: &mut Warnings) {
    for semantic in primitive.attributes.keys() {
        let other = match semantic {
            Checked::Valid(Semantic::Joints(set)) => Checked::Valid(Semantic::Weights(*set)),
            Checked::Valid(Semantic::Weights(set)) => Checked::Valid(Semantic::Joints(*set)),
            _ => continue,
        };
        if !primitive.attributes.contains_key(&other) {
            let (one, other) = (semantic.to_string(), other.to_string());
            warnings.push(place, format!("it has {one} without {other}; this set moves no vertex"));
        }
    }
}

/// Adds `weight` times the displacements of one target.
fn morph(mesh: &mut Mesh, accessors: &Accessors<'_>, target: &MorphTarget, weight: f32) -> Result<(), String> {
    let vertices = mesh.positions.len();
    let read = |name: &str, index: Option<Index<Accessor>>| -> Result<Option<Vec<[f32; 3]>>, String> {
        let Some(index) = index else { return Ok(None) };
        match accessors.count(index.value()) {
            Some(n) if n != vertices => Err(format!("its {name} has {n} elements for {vertices} vertices")),
            _ => accessors.vectors::<3>(index.value(), Stored::Quantized).map(Some),
        }
    };
    let (positions, normals, tangents) =
        (read("POSITION", target.positions)?, read("NORMAL", target.normals)?, read("TANGENT", target.tangents)?);
    let moved = |deltas: Option<Vec<[f32; 3]>>| deltas.into_iter().flatten().map(move |d| weight * Vec3::from_array(d));
    mesh.positions.iter_mut().zip(moved(positions)).for_each(|(p, d)| *p += d);
    mesh.normals.iter_mut().zip(moved(normals)).for_each(|(n, d)| *n += d);
    mesh.tangents.iter_mut().zip(moved(tangents)).for_each(|(t, d)| *t += d.extend(0.0));
    Ok(())
}

/// Linear blend skinning (Magnenat-Thalmann et al., 1988) with any number of joint sets.
fn skin(mesh: &mut Mesh, accessors: &Accessors<'_>, primitive: &Primitive, pose: &Pose) -> Result<(), String> {
    let mut sets = Vec::new();
    for i in 0.. {
        let joints = attribute(primitive, Semantic::Joints(i));
        let (Some(joints), Some(weights)) = (joints, attribute(primitive, Semantic::Weights(i))) else { break };
        for index in [joints, weights] {
            if accessors.count(index) != Some(mesh.positions.len()) {
                return Err(format!("accessor {index} has not one element per vertex"));
            }
        }
        sets.push((accessors.whole::<4>(joints)?, accessors.vectors::<4>(weights, Stored::Normalized)?));
    }
    let (first, _) = sets.first().ok_or("it has no JOINTS_0 and WEIGHTS_0")?;
    let unusable = sets.iter().any(|(joints, weights)| {
        let mut pairs = joints.iter().flatten().zip(weights.iter().flatten());
        pairs.any(|(joint, weight)| !weight.is_finite() || (*weight > 0.0 && *joint as usize >= pose.joints.len()))
    });
    if unusable {
        return Err("a joint index is out of range or a weight is not finite".into());
    }
    let mut mirrored = 0_usize;
    for v in 0..mesh.positions.len() {
        let mut sum = DAffine3::from_mat3_translation(DMat3::ZERO, DVec3::ZERO);
        let mut total = 0.0;
        for (joints, weights) in &sets {
            for (joint, weight) in joints[v].iter().zip(weights[v]).filter(|(_, w)| *w > 0.0) {
                let matrix = &pose.joints[*joint as usize];
                sum.matrix3 += matrix.matrix3 * f64::from(weight);
                sum.translation += matrix.translation * f64::from(weight);
                total += f64::from(weight);
            }
        }
        let blended = if total > 0.0 {
            DAffine3::from_mat3_translation(sum.matrix3 * (1.0 / total), sum.translation / total)
        } else {
            // Vertices whose weights sum to 0 follow their first joint, as in viewers.
            *pose.joints.get(first[v][0] as usize).unwrap_or(&pose.joints[0])
        };
        mesh.positions[v] = blended.transform_point3(mesh.positions[v].as_dvec3()).as_vec3();
        let determinant = blended.matrix3.determinant();
        mirrored += usize::from(determinant < 0.0);
        if let Some(n) = mesh.normals.get_mut(v) {
            // The inverse transpose up to scale, which exists for flattening matrices too.
            let m = blended.matrix3;
            let cofactor =
                DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
            let sign = if determinant < 0.0 { -1.0 } else { 1.0 };
            *n = (cofactor * n.as_dvec3() * sign).normalize_or_zero().as_vec3();
        }
        if let Some(t) = mesh.tangents.get_mut(v) {
            let direction = (blended.matrix3 * t.truncate().as_dvec3()).normalize_or_zero().as_vec3();
            *t = direction.extend(if determinant < 0.0 { -t.w } else { t.w });
        }
    }
    // The instance only translates, so a mirroring skin has to turn the winding here.
    if mirrored * 2 > mesh.positions.len() {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(())
}

fn affine(m: &[f32; 16]) -> DAffine3 {
    let column = |c: usize| DVec3::new(f64::from(m[c]), f64::from(m[c + 1]), f64::from(m[c + 2]));
    DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12))
}
