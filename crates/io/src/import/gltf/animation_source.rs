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

/// The animations of a JSON text. A text whose animations cannot be read has none.
pub(super) fn read(json: &[u8]) -> Vec<Animation> {
    #[derive(Default, Deserialize)]
    struct Source {
        #[serde(default)]
        animations: Vec<Value>,
    }
    let source: Source = serde_json::from_slice(json).unwrap_or_default();
    source.animations.into_iter().map(|a| Animation::deserialize(a).unwrap_or_default()).collect()
}
