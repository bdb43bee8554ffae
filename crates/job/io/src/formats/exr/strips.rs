//! Writes EXR files in strips of rows, so that no more than one strip of all channels is in memory.

use std::io::{self, Seek, Write};
use std::ops::Range;
use std::path::Path;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, ChannelList, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use exr::meta::{BlockDescription, compute_chunk_count};
use exr::prelude::{Compression, Vec2};
use rayon::prelude::*;

use super::{ATTRIBUTE, Channel, ExrFrame, ExrLayers, ascii_json};
use crate::atomic::write_atomically;

/// Lines that ZIP compresses together.
const BLOCK_LINES: u32 = 16;

/// Level of deflate. The higher ones take six times as long for files that are 2 % smaller: most bytes are noise.
const LEVEL: u8 = 1;

/// Approximate maximum of the samples of a strip \[bytes\]. A strip has at least [`BLOCK_LINES`] lines.
const STRIP_BYTES: u64 = 32 << 20;

/// The type of a channel's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelKind {
    /// 32-bit floating point.
    F32,
    /// 32-bit unsigned integers.
    U32,
}

impl Channel {
    /// The type of its samples.
    pub fn kind(&self) -> ChannelKind {
        match self {
            Self::F32(_) => ChannelKind::F32,
            Self::U32(_) => ChannelKind::U32,
        }
    }
}

/// All contents of a file except the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrHead {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Names and types of the channels, in the order of the channels of the strips.
    pub channels: Vec<(String, ChannelKind)>,
    /// A JSON text about the image; empty if there is none.
    pub attributes: String,
    /// Windows and primaries; `None`: the samples are the picture, in Rec. 709.
    pub frame: Option<ExrFrame>,
}

impl ExrHead {
    /// The head of an image with this number of rows. Its strips have the channels, the width and the attributes of
    /// this one.
    pub fn from_strip(strip: &ExrLayers, height: u32) -> Self {
        let channels = strip.channels.iter().map(|(name, channel)| (name.clone(), channel.kind())).collect();
        Self { width: strip.width, height, channels, attributes: strip.attributes.clone(), frame: strip.frame }
    }

    /// Rows of a strip: the blocks of 16 lines whose samples of all channels have less than 32 MiB, at least one block.
    pub fn strip_rows(&self) -> u32 {
        let line = (u64::from(self.width) * self.channels.len() as u64 * 4).max(1);
        let blocks = (STRIP_BYTES / line / u64::from(BLOCK_LINES)).max(1);
        u32::try_from(blocks).unwrap_or(u32::MAX).saturating_mul(BLOCK_LINES).min(self.height.max(1))
    }

    fn check(&self) -> io::Result<()> {
        if self.width == 0 || self.height == 0 || self.channels.is_empty() {
            return refuse("an EXR needs at least one pixel and one channel".into());
        }
        let mut names: Vec<&str> = self.channels.iter().map(|(name, _)| name.as_str()).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
            return refuse(format!("the channel `{}` is there twice", twice[0]));
        }
        for (name, _) in &self.channels {
            if name.is_empty() || name.len() > 255 || !name.bytes().all(|b| (b' '..=b'~').contains(&b)) {
                return refuse(format!("`{name}` is not a channel name: 1 to 255 printable ASCII characters"));
            }
        }
        Ok(())
    }

    /// Does a strip with this number of rows have the channels of the head?
    fn check_strip(&self, strip: &[Channel], rows: u32) -> io::Result<()> {
        let samples = self.width as usize * rows as usize;
        if strip.len() != self.channels.len() {
            return refuse(format!("a strip has {} channels, the image {}", strip.len(), self.channels.len()));
        }
        for ((name, kind), channel) in self.channels.iter().zip(strip) {
            if channel.kind() != *kind {
                return refuse(format!("the channel `{name}` changes its type"));
            }
            if channel.len() != samples {
                return refuse(format!(
                    "the channel `{name}` has {} samples for {samples} pixels, in a strip of {rows} rows",
                    channel.len()
                ));
            }
        }
        Ok(())
    }

    /// The header in the format of EXR. It sorts the channels; the result contains their places in [`Self::channels`].
    fn header(&self) -> (Header, Vec<usize>) {
        let mut order: Vec<usize> = (0..self.channels.len()).collect();
        order.sort_unstable_by_key(|&i| self.channels[i].0.as_bytes());
        let describe = |&i: &usize| {
            let (name, kind) = &self.channels[i];
            let sample_type = match kind {
                ChannelKind::F32 => SampleType::F32,
                ChannelKind::U32 => SampleType::U32,
            };
            ChannelDescription::named(name.as_str(), sample_type)
        };
        let channels = ChannelList::new(order.iter().map(describe).collect());
        let size = Vec2(self.width as usize, self.height as usize);
        let mut shared_attributes = ImageAttributes::new(IntegerBounds::from_dimensions(size));
        if !self.attributes.is_empty() {
            let value = AttributeValue::Text(Text::from(ascii_json(&self.attributes).as_str()));
            shared_attributes.other.insert(Text::from(ATTRIBUTE), value);
        }
        let (compression, blocks) = (Compression::ZIP16, BlockDescription::ScanLines);
        let mut header = Header {
            channels,
            compression,
            blocks,
            line_order: LineOrder::Increasing,
            layer_size: size,
            chunk_count: compute_chunk_count(compression, size, blocks),
            shared_attributes,
            own_attributes: LayerAttributes::default(),
            deep: false,
            deep_data_version: None,
            max_samples_per_pixel: None,
        };
        self.frame.iter().for_each(|frame| frame.apply(&mut header));
        (header, order)
    }
}

fn refuse<T>(problem: String) -> io::Result<T> {
    Err(io::Error::new(io::ErrorKind::InvalidInput, problem))
}

/// Writes a file like [`write_exr`](super::write_exr), with the same bytes, without all of its samples at once.
///
/// `rows` is called for consecutive strips from the top: ranges of rows, of [`ExrHead::strip_rows`] each but for the
/// last one.
/// It returns a channel for each one of the head, in their order, with the samples of these rows. The strips are compressed on
/// the threads of the current pool.
///
/// # Errors
/// Those of the file system and of `rows`; no pixels, no channels, a channel of the wrong length or type, a name that is empty,
/// double, not ASCII or longer than 255 bytes. An existing file stays as it was.
pub fn write_exr_rows(
    path: &Path,
    head: &ExrHead,
    rows: &mut dyn FnMut(Range<u32>) -> io::Result<Vec<Channel>>,
) -> io::Result<()> {
    head.check()?;
    write_atomically(path, |file| encode(file, head, head.strip_rows(), rows))
}

/// Encodes the file of [`write_exr_rows`], in strips of this number of rows, a multiple of 16 or all of them. The head has been
/// checked.
fn encode(
    file: impl Write + Seek,
    head: &ExrHead,
    strip_rows: u32,
    rows: &mut dyn FnMut(Range<u32>) -> io::Result<Vec<Channel>>,
) -> io::Result<()> {
    let (header, order) = head.header();
    let top = header.own_attributes.layer_position.y();
    exr::block::write(file, [header].into_iter().collect(), true, |_, writer| {
        let mut strip: Vec<Channel> = Vec::new();
        for first in (0..head.height).step_by(strip_rows.max(1) as usize) {
            let range = first..head.height.min(first.saturating_add(strip_rows));
            // The previous strip is dropped first, so that there is never more than one.
            drop(strip);
            strip = rows(range.clone())?;
            head.check_strip(&strip, range.end - range.start)?;
            let blocks: Vec<u32> = range.clone().step_by(BLOCK_LINES as usize).collect();
            let compress = |&y: &u32| {
                let lines = y - first..range.end.min(y + BLOCK_LINES) - first;
                zip(&block_of(&strip, &order, lines, head.width as usize))
            };
            let compressed: Vec<Vec<u8>> = blocks.par_iter().map(compress).collect();
            for (y, compressed_pixels_le) in blocks.into_iter().zip(compressed) {
                let block =
                    CompressedScanLineBlock { y_coordinate: top.saturating_add_unsigned(y), compressed_pixels_le };
                let chunk = Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) };
                writer.write_chunk((y / BLOCK_LINES) as usize, chunk)?;
            }
        }
        Ok(())
    })
    .map_err(|e| match e {
        exr::error::Error::Io(e) => e,
        other => io::Error::other(other.to_string()),
    })
}

/// The bytes of a block of lines of a strip: line by line, the samples of each channel. `order` contains the places of the
/// header's channels in the strip.
fn block_of(strip: &[Channel], order: &[usize], lines: Range<u32>, width: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(4 * width * order.len() * lines.len());
    for y in lines.start as usize..lines.end as usize {
        let samples = y * width..(y + 1) * width;
        for &channel in order {
            match &strip[channel] {
                Channel::F32(v) => v[samples.clone()].iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes())),
                Channel::U32(v) => v[samples.clone()].iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes())),
            }
        }
    }
    bytes
}

/// ZIP compression of a block (OpenEXR, `ImfZip.cpp`): the even bytes, then the odd ones, as differences plus 128, deflated. A
/// block that does not shrink stays as it is.
fn zip(block: &[u8]) -> Vec<u8> {
    let pairs = block.as_chunks::<2>().0;
    let mut last = 128;
    let bytes = pairs.iter().map(|pair| pair[0]).chain(pairs.iter().map(|pair| pair[1]));
    let differences: Vec<u8> =
        bytes.map(|byte| byte.wrapping_sub(std::mem::replace(&mut last, byte)).wrapping_add(128)).collect();
    let zipped = miniz_oxide::deflate::compress_to_vec_zlib(&differences, LEVEL);
    if zipped.len() < block.len() { zipped } else { block.to_vec() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: u32 = 37;

    fn strip(rows: &Range<u32>) -> Vec<Channel> {
        let samples = rows.start * WIDTH..rows.end * WIDTH;
        let values = samples.clone().map(|i| (i.wrapping_mul(2_654_435_761) >> 8) as f32).collect();
        vec![Channel::U32(samples.map(|i| i << 7).collect()), Channel::F32(values)]
    }

    fn head(height: u32) -> ExrHead {
        let channels = vec![("spp.Y".into(), ChannelKind::U32), ("Y".into(), ChannelKind::F32)];
        ExrHead { width: WIDTH, height, channels, attributes: "{}".into(), frame: None }
    }

    #[test]
    fn strips_of_any_number_of_rows_make_the_same_bytes() {
        for height in [1, 15, 16, 17, 33, 64, 100] {
            let mut files = Vec::new();
            for strip_rows in [16, 32, 48, 112] {
                let (mut file, mut asked) = (io::Cursor::new(Vec::new()), Vec::new());
                let mut rows = |rows: Range<u32>| {
                    asked.push((rows.start, rows.end));
                    Ok(strip(&rows))
                };
                encode(&mut file, &head(height), strip_rows, &mut rows).expect("written");
                let expected: Vec<_> = (0..height.div_ceil(strip_rows))
                    .map(|i| (i * strip_rows, height.min((i + 1) * strip_rows)))
                    .collect();
                assert_eq!(asked, expected, "{height} rows in strips of {strip_rows}");
                files.push(file.into_inner());
            }
            assert!(files.windows(2).all(|w| w[0] == w[1]), "{height} rows");
        }
    }

    #[test]
    fn a_later_strip_that_fails_is_an_error() {
        for fails_at in [0, 16, 48] {
            let error = encode(io::Cursor::new(Vec::new()), &head(50), 16, &mut |rows| match rows.start {
                start if start == fails_at => Err(io::Error::new(io::ErrorKind::OutOfMemory, "no more")),
                _ => Ok(strip(&rows)),
            })
            .expect_err("a strip failed");
            assert_eq!((error.kind(), error.to_string().as_str()), (io::ErrorKind::OutOfMemory, "no more"));
            let short = encode(io::Cursor::new(Vec::new()), &head(50), 16, &mut |rows| match rows.start {
                start if start == fails_at => Ok(strip(&(rows.start..rows.end - 1))),
                _ => Ok(strip(&rows)),
            });
            assert_eq!(short.expect_err("a row is missing").kind(), io::ErrorKind::InvalidInput);
        }
    }
}
