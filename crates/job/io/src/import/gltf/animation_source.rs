//! Animations as they are written in a glTF file.

use serde::Deserialize;
use serde_json::Value;

/// An animation as in the file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Animation {
    pub(super) channels: Vec<ChannelSource>,
    pub(super) samplers: Vec<SamplerSource>,
}

#[derive(Clone, Debug, Deserialize)]
pub(super) struct ChannelSource {
    pub(super) sampler: usize,
    pub(super) target: TargetSource,
}

#[derive(Clone, Debug, Deserialize)]
pub(super) struct TargetSource {
    pub(super) node: Option<usize>,
    pub(super) path: String,
}

#[derive(Clone, Debug, Deserialize)]
pub(super) struct SamplerSource {
    pub(super) input: usize,
    pub(super) output: usize,
    pub(super) interpolation: Option<String>,
}

/// The animations of a file. One that cannot be read has no channels.
pub(super) fn read(animations: Option<Value>) -> Vec<Animation> {
    let Some(Value::Array(animations)) = animations else { return Vec::new() };
    animations.into_iter().map(|a| Animation::deserialize(a).unwrap_or_default()).collect()
}
