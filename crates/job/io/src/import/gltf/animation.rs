//! Animations of nodes (glTF 2.0, section 3.11): the transforms of the nodes at a time, and the motion of the objects.
//!
//! Only the first animation is read: translation, rotation and scale of nodes. Objects move rigidly at the velocity
//! that they have at the time, by a finite difference. Faults in an animation are warnings.

use super::accessor::{Accessors, Stored};
use super::extensions::Transform;
use crate::import::warnings::Warnings;
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, RigidMotion, Spin};
use gltf::json::animation::{Animation, Channel as Source, Interpolation, Property};
use gltf::json::validation::Checked;
use serde::Deserialize;
use serde_json::Value;

/// Step of the finite difference \[s\].
const STEP: f64 = 1e-4;
/// Relative change of a length over the difference above which a motion is not rigid.
const STRETCH: f64 = 1e-6;

/// One animated property of a node.
struct Channel {
    node: usize,
    path: Property,
    interpolation: Interpolation,
    times: Vec<f64>,
    /// One value a key, or three for Hermite splines, of which the second one is the value. Translations and scales have three components.
    values: Vec<[f64; 4]>,
}

/// The channels of the first animation, ready for evaluation.
pub(super) struct Channels {
    channels: Vec<Channel>,
    time: f64,
}

/// The animations of a file. One that cannot be read has no effect.
pub(super) fn read(animations: Option<Value>) -> Vec<Animation> {
    let Some(Value::Array(animations)) = animations else { return Vec::new() };
    let read = |mut animation: Value| {
        // `gltf::json` refuses channels of KHR_animation_pointer, which have no node.
        if let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) {
            channels.retain(|channel| channel.pointer("/target/node").is_some());
        }
        Animation::deserialize(animation).ok()
    };
    animations.into_iter().filter_map(read).collect()
}

impl Channels {
    /// Reads the first animation, to be evaluated at the time `time` \[s\]. `None` if there is none that moves a node.
    pub(super) fn new(
        animations: &[Animation],
        nodes: usize,
        accessors: &Accessors<'_>,
        time: f64,
        warnings: &mut Warnings,
    ) -> Option<Self> {
        let (first, others) = animations.split_first()?;
        let mut channels = Vec::new();
        for (i, source) in first.channels.iter().enumerate() {
            match channel(first, source, nodes, accessors) {
                Ok(channel) => channels.extend(channel),
                Err(fault) => warnings.push(format!("animation 0, channel {i}"), format!("{fault}; it is left out")),
            }
        }
        if channels.is_empty() {
            return None;
        }
        let mut message = format!(
            "nodes have their pose at {time} s (`[import] animation_time`); while the sensor is exposed for a fixed \
             time, objects move at their velocity at that time"
        );
        if !others.is_empty() {
            message += &format!("; {} further animations are left out", others.len());
        }
        warnings.push("animation 0", message);
        Some(Self { channels, time })
    }

    /// The transforms of all nodes at the time of the animation.
    pub(super) fn transforms(&self, rest: &[Transform]) -> Vec<Transform> {
        self.at(rest, self.time)
    }

    /// Two times around that of the animation, inside its keys, with the transforms there. `None` where it is at rest.
    pub(super) fn around(&self, rest: &[Transform]) -> Option<[(f64, Vec<Transform>); 2]> {
        let first = self.channels.iter().filter_map(|c| c.times.first()).fold(f64::INFINITY, |a, b| a.min(*b));
        let last = self.channels.iter().filter_map(|c| c.times.last()).fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        let (from, to) = ((self.time - STEP).max(first), (self.time + STEP).min(last));
        (to > from).then(|| [from, to].map(|t| (t, self.at(rest, t))))
    }

    fn at(&self, rest: &[Transform], time: f64) -> Vec<Transform> {
        let mut transforms = rest.to_vec();
        for channel in &self.channels {
            let Some(transform) = transforms.get_mut(channel.node) else { continue };
            // A step does not move, so both ends of a difference have the same key.
            let time = if channel.interpolation == Interpolation::Step { self.time } else { time };
            let value = channel.value(time);
            let three = [value[0], value[1], value[2]];
            transform.matrix = None;
            match channel.path {
                Property::Translation => transform.translation = Some(three),
                Property::Rotation => transform.rotation = Some(value),
                Property::Scale => transform.scale = Some(three),
                Property::MorphTargetWeights => {}
            }
        }
        transforms
    }
}

/// A channel of a node. `None` for morph weights, which are not read.
fn channel(
    animation: &Animation,
    source: &Source,
    nodes: usize,
    accessors: &Accessors<'_>,
) -> Result<Option<Channel>, String> {
    let path = match source.target.path {
        Checked::Valid(path) if path != Property::MorphTargetWeights => path,
        _ => return Ok(None),
    };
    let node = source.target.node.value();
    if node >= nodes {
        return Err(format!("its node {node} does not exist"));
    }
    let sampler = animation.samplers.get(source.sampler.value());
    let sampler = sampler.ok_or_else(|| format!("its sampler {} does not exist", source.sampler))?;
    let Checked::Valid(interpolation) = sampler.interpolation else {
        return Err("its interpolation does not exist".into());
    };
    let times: Vec<f64> =
        accessors.vectors::<1>(sampler.input.value(), Stored::Float)?.into_iter().map(|[t]| f64::from(t)).collect();
    let values: Vec<[f64; 4]> = if path == Property::Rotation {
        accessors
            .vectors::<4>(sampler.output.value(), Stored::Quantized)?
            .into_iter()
            .map(|v| v.map(f64::from))
            .collect()
    } else {
        let values = accessors.vectors::<3>(sampler.output.value(), Stored::Float)?;
        values.into_iter().map(|[x, y, z]| [x, y, z, 0.0].map(f64::from)).collect()
    };
    let is_increasing = times.windows(2).all(|w| w[0] < w[1]) && times.iter().all(|t| t.is_finite());
    if times.is_empty() || !is_increasing {
        return Err("its times are not increasing".into());
    }
    let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    if values.len() != per_key * times.len() || !values.iter().flatten().all(|v| v.is_finite()) {
        return Err("its values do not fit its times".into());
    }
    Ok(Some(Channel { node, path, interpolation, times, values }))
}

impl Channel {
    fn value(&self, time: f64) -> [f64; 4] {
        let after = self.times.partition_point(|t| *t <= time);
        let per_key = self.values.len() / self.times.len();
        let key = |i: usize| self.values[per_key * i + per_key / 2];
        if after == 0 || after == self.times.len() {
            return key(after.saturating_sub(1));
        }
        let (before, span) = (after - 1, self.times[after] - self.times[after - 1]);
        let s = (time - self.times[before]) / span;
        let mixed = |a: [f64; 4], b: [f64; 4], u: f64, v: f64| std::array::from_fn(|i| u * a[i] + v * b[i]);
        match self.interpolation {
            Interpolation::Step => key(before),
            Interpolation::Linear if self.path == Property::Rotation => {
                let [a, b] = [key(before), key(after)].map(DQuat::from_array);
                match (a.length() > 0.0, b.length() > 0.0) {
                    (true, true) => a.normalize().slerp(b.normalize(), s).to_array(),
                    _ => key(before),
                }
            }
            Interpolation::Linear => mixed(key(before), key(after), 1.0 - s, s),
            Interpolation::CubicSpline => {
                // The Hermite basis (glTF 2.0, appendix C): values and tangents of both keys.
                let (s2, s3) = (s * s, s * s * s);
                let ends: [f64; 4] = mixed(key(before), key(after), 2.0 * s3 - 3.0 * s2 + 1.0, 3.0 * s2 - 2.0 * s3);
                let (out, into) = (self.values[3 * before + 2], self.values[3 * after]);
                let tangents: [f64; 4] = mixed(out, into, span * (s3 - 2.0 * s2 + s), span * (s3 - s2));
                mixed(ends, tangents, 1.0, 1.0)
            }
        }
    }
}

/// The motion of a node whose transform is `at` now, `before` at an earlier and `after` at a later time, `span` \[s\]
/// later. `None` if it is no rigid motion.
pub(super) fn motion(before: &DAffine3, at: &DAffine3, after: &DAffine3, span: f64) -> Option<RigidMotion> {
    if before == after {
        return Some(RigidMotion::default());
    }
    let turn = after.matrix3 * before.matrix3.inverse();
    let columns = [turn.x_axis, turn.y_axis, turn.z_axis];
    let is_rigid = columns.iter().all(|c| (c.length() - 1.0).abs() <= STRETCH)
        && [(0, 1), (1, 2), (2, 0)].iter().all(|&(i, j)| columns[i].dot(columns[j]).abs() <= STRETCH);
    if !is_rigid || turn.determinant() <= 0.0 {
        return None;
    }
    // The axis is that of the antisymmetric part; its length is twice the sine of the angle. A difference is short, so
    // that the angle is below a quarter turn, except at speeds beyond 1000 turns a second.
    let twice_sine =
        DVec3::new(turn.y_axis.z - turn.z_axis.y, turn.z_axis.x - turn.x_axis.z, turn.x_axis.y - turn.y_axis.x);
    let angle = (0.5 * twice_sine.length()).atan2(0.5 * (columns[0].x + columns[1].y + columns[2].z - 1.0));
    let spin = twice_sine.try_normalize().map(|axis| Spin { axis, origin: at.translation, speed: angle / span });
    Some(RigidMotion { velocity: (after.translation - before.translation) / span, spin })
}
