//! OpenEXR files: any number of named channels in one file, byte for byte reproducible.

use std::io::{self, BufReader, Seek as _};
use std::path::Path;

use exr::image::FlatSamples;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, Text};
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, read};

use crate::error::InputError;
use crate::input::{InputFiles, MAX_STREAMED, Role};
use crate::process::can_reserve;

pub(crate) mod blocks;
mod strips;
mod windows;

pub use windows::ExrFrame;

pub use strips::{ChannelKind, ExrHead, write_exr_rows};

/// Name of the one attribute with all metadata of an image, as JSON. There is only one, because the order of several
/// would differ from run to run.
const ATTRIBUTE: &str = "dunkelfeld";

/// Largest possible ratio of compression: deflate's 1032 : 1. A header with a higher ratio is invalid.
const MAX_SHRINK: u64 = 1100;

/// The samples of one channel, row by row.
#[derive(Clone, Debug, PartialEq)]
pub enum Channel {
    /// 32-bit floating point. Half precision is widened when read.
    F32(Vec<f32>),
    /// 32-bit unsigned integers, for identities and counts.
    U32(Vec<u32>),
}

impl Channel {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(v) => v.len(),
            Self::U32(v) => v.len(),
        }
    }

    /// Are there no samples?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The contents of a file: channels of one size, by name (`R`, `variance.R`, `id.object`, ...).
///
/// `layers.rs` adds and extracts planes.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrLayers {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Names and samples. Written in the order of the names.
    pub channels: Vec<(String, Channel)>,
    /// A JSON text about the image; empty if there is none.
    pub attributes: String,
    /// Windows and primaries of a file of another program. `None`: the samples are the picture, in Rec. 709.
    pub frame: Option<ExrFrame>,
}

/// Writes a file: one part, scan lines from the top, ZIP in blocks of 16 lines. The same contents give the same bytes. Runs on
/// the threads of the current pool.
///
/// [`write_exr_rows`] is for images whose samples do not fit into memory at once.
///
/// # Errors
/// Those of the file system; no pixels, no channels, a channel of the wrong length, a name that is empty, double, not
/// ASCII or longer than 255 bytes. An existing file stays as it was.
pub fn write_exr(path: &Path, layers: ExrLayers) -> io::Result<()> {
    let head = ExrHead::from_strip(&layers, layers.height);
    let width = layers.width as usize;
    let pixels = width * layers.height as usize;
    for (name, channel) in &layers.channels {
        if channel.len() != pixels {
            let problem = format!("the channel `{name}` has {} samples, the image {pixels} pixels", channel.len());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
    }
    write_exr_rows(path, &head, &mut |rows| {
        let samples = rows.start as usize * width..rows.end as usize * width;
        let strip = layers.channels.iter().map(|(_, channel)| match channel {
            Channel::F32(v) => Channel::F32(v[samples.clone()].to_vec()),
            Channel::U32(v) => Channel::U32(v[samples.clone()].to_vec()),
        });
        Ok(strip.collect())
    })
}

/// The same JSON in ASCII: texts in EXR are Latin-1. Beyond ASCII, JSON has characters only within its strings, where
/// they can be escaped.
fn ascii_json(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii() {
            out.push(c);
        } else {
            let mut units = [0; 2];
            for unit in c.encode_utf16(&mut units) {
                out.push_str(&format!("\\u{unit:04x}"));
            }
        }
    }
    out
}

/// Reads all channels of a file, of this program or of another renderer.
///
/// Half precision is widened. The channels of a part that has a name are called `part.channel`. Channels that do not have
/// one sample per pixel, and parts that differ in size or place from the first, are left out. The samples are those of
/// the data window; [`ExrLayers::displayed`] moves them into the display window.
///
/// # Errors
/// The file is missing, not an EXR, damaged, or uses deep data.
pub fn read_exr(path: &Path) -> Result<ExrLayers, InputError> {
    read_exr_recorded(path, Role::Image, &mut InputFiles::new())
}

/// [`read_exr`], and records the file as an input.
///
/// # Errors
/// As [`read_exr`].
pub fn read_exr_recorded(path: &Path, role: Role, inputs: &mut InputFiles) -> Result<ExrLayers, InputError> {
    read_exr_if(path, role, inputs, |_| Ok(()))
}

/// The size of an image, before its samples are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExrSize {
    /// Width of the first part or of its display window in pixels: the larger one.
    pub width: u32,
    /// Height, likewise.
    pub height: u32,
    /// Bytes that the samples of all channels take in memory.
    pub bytes: u64,
}

/// [`read_exr_recorded`], if `agree` accepts the size of the image before the memory for its samples is allocated.
///
/// # Errors
/// As [`read_exr`], and those of `agree`.
pub fn read_exr_if<E: From<InputError>>(
    path: &Path,
    role: Role,
    inputs: &mut InputFiles,
    agree: impl FnOnce(ExrSize) -> Result<(), E>,
) -> Result<ExrLayers, E> {
    let fault = |problem: String| {
        let help = "check that it is a complete OpenEXR image without deep data, with ZIP, PIZ or no compression";
        InputError::of_file(path, problem, help)
    };
    let file = inputs.open(path, role, MAX_STREAMED).map_err(|fault| fault.at(path))?;
    let size = file.length();
    let mut file = BufReader::new(file);
    let meta = blocks::guard(|| MetaData::read_from_buffered(&mut file, false)).map_err(|e| fault(describe(&e)))?;
    file.rewind().map_err(|e| fault(format!("cannot be read: {e}")))?;
    let size_in_memory = size_of_all(&meta);
    let promised: u64 = meta
        .headers
        .iter()
        .map(|h| {
            let samples = (h.layer_size.0 as u64).saturating_mul(h.layer_size.1 as u64);
            samples.saturating_mul(h.channels.bytes_per_pixel as u64)
        })
        .fold(0, u64::saturating_add);
    if promised > size.saturating_mul(MAX_SHRINK) {
        return Err(fault(format!("states {promised} bytes of samples in a file of {size} bytes")).into());
    }
    agree(size_in_memory)?;
    // The decoder collects them, and half precision is widened. So the maximum at a time is twice their size.
    let bytes = size_in_memory.bytes;
    if !can_reserve(bytes.saturating_mul(2)) {
        let problem = format!("has samples of {} MB, for which there is not enough memory", bytes.div_ceil(1_000_000));
        let help = "use a smaller image or one with fewer channels, or end other programs";
        return Err(InputError::of_file(path, problem, help).into());
    }
    let layers = read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let image = blocks::decode(file, &layers).map_err(|e| fault(describe(&e)))?;
    collect(image, meta.headers.first().and_then(ExrFrame::of_header))
        .ok_or_else(|| fault("has no channel with one sample per pixel".into()).into())
}

/// Width and height of the first part or its display window, and bytes of all samples in memory.
fn size_of_all(meta: &MetaData) -> ExrSize {
    let of = |h: &Header| {
        let display = h.shared_attributes.display_window.size;
        [h.layer_size.0.max(display.0), h.layer_size.1.max(display.1)]
    };
    let bytes = meta.headers.iter().map(|h| {
        let [width, height] = of(h).map(|v| v as u64);
        width.saturating_mul(height).saturating_mul(4 * h.channels.list.len() as u64)
    });
    let [width, height] = meta.headers.first().map_or([0; 2], of).map(|v| u32::try_from(v).unwrap_or(u32::MAX));
    ExrSize { width, height, bytes: bytes.fold(0, u64::saturating_add) }
}

fn describe(error: &exr::error::Error) -> String {
    use exr::error::Error;
    match error {
        Error::Io(e) => format!("cannot be read: {e}"),
        Error::NotSupported(what) => format!("uses what is not supported: {what}"),
        Error::Invalid(what) => format!("is not a valid EXR: {what}"),
        Error::Aborted => "was not read to its end".into(),
    }
}

fn collect(image: exr::image::FlatImage, frame: Option<ExrFrame>) -> Option<ExrLayers> {
    let first = image.layer_data.first()?;
    let (size, position) = (first.size, first.attributes.layer_position);
    let attributes = image
        .attributes
        .other
        .iter()
        .chain(image.layer_data.first().into_iter().flat_map(|l| &l.attributes.other))
        .find_map(|(name, value)| match value {
            AttributeValue::Text(text) if name.eq(ATTRIBUTE) => Some(text.to_string()),
            _ => None,
        })
        .unwrap_or_default();
    let (width, height) = (u32::try_from(size.0).ok()?, u32::try_from(size.1).ok()?);
    let mut channels = Vec::new();
    for layer in image.layer_data.into_iter().filter(|l| (l.size, l.attributes.layer_position) == (size, position)) {
        let part = layer.attributes.layer_name.as_ref().map(Text::to_string).filter(|name| !name.is_empty());
        for channel in layer.channel_data.list {
            let samples = match channel.sample_data {
                FlatSamples::F16(v) => Channel::F32(v.into_iter().map(|h| h.to_f32()).collect()),
                FlatSamples::F32(v) => Channel::F32(v),
                FlatSamples::U32(v) => Channel::U32(v),
            };
            let whole = (channel.sampling.0, channel.sampling.1) == (1, 1) && samples.len() == size.0 * size.1;
            if whole {
                let name = channel.name.to_string();
                let name = match &part {
                    Some(part) if !name.starts_with(&format!("{part}.")) => format!("{part}.{name}"),
                    _ => name,
                };
                channels.push((name, samples));
            }
        }
    }
    (!channels.is_empty()).then_some(ExrLayers { width, height, channels, attributes, frame })
}
