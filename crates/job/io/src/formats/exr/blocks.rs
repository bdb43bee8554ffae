//! Decodes the blocks of an EXR on several threads. A panic of the decoder is reported as an invalid file.

use std::io::{Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread;

use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::reader::ChunksReader as _;
use exr::error::{Error, Result};
use exr::image::Image;
use exr::image::read::image::{LayersReader as _, ReadLayers};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::Compression;

use crate::process::can_reserve;

/// Sizes at the beginning of a block of DWA, after its version: 64 bits each.
const DWA_SIZES: usize = 9;

/// Size of tiles that are always read \[bytes\], also if the image is smaller.
const LARGEST_TILE: u64 = 16 << 20;

/// Blocks that a thread decodes between two starts of threads.
const BLOCKS_PER_THREAD: usize = 8;

/// The layers that `layers` selects.
///
/// A panic in the decoder's own threads ends the process. So it gets one block at a time, and only blocks within the
/// size of the image.
///
/// # Errors
/// The file cannot be read, is damaged, or contains data that `layers` refuses.
pub(crate) fn decode<'s, L: ReadLayers<'s>>(file: impl Read + Seek, layers: &'s L) -> Result<Image<L::Layers>> {
    guard(|| {
        let reader = exr::block::read(file, false)?;
        let first = reader.headers().first().ok_or(Error::Invalid("no parts".into()))?;
        let attributes = first.shared_attributes.clone();
        reader.headers().iter().try_for_each(check_largest_block)?;
        let mut collector = layers.create_layers_reader(reader.headers())?;
        let mut chunks = reader.filter_chunks(false, |meta, tile, block| collector.filter_block(meta, tile, block))?;
        let meta = chunks.meta_data().clone();
        let threads = thread::available_parallelism().map_or(1, usize::from);
        loop {
            let batch: Vec<Chunk> = chunks.by_ref().take(threads * BLOCKS_PER_THREAD).collect::<Result<_>>()?;
            if batch.is_empty() {
                break;
            }
            for chunk in &batch {
                check_promises(chunk, &meta)?;
            }
            for block in decode_blocks(batch, &meta, threads)? {
                collector.read_block(&meta.headers, block)?;
            }
        }
        Ok(Image { attributes, layer_data: collector.into_layers() })
    })
}

/// Before it reads a block, the decoder allocates as many bytes as the block gives and the header allows.
fn check_largest_block(header: &Header) -> Result<()> {
    let bytes_of = |(width, height): (usize, usize)| {
        (width as u64).saturating_mul(height as u64).saturating_mul(header.channels.bytes_per_pixel as u64)
    };
    let image = bytes_of((header.layer_size.0, header.layer_size.1));
    let block = match header.blocks {
        BlockDescription::Tiles(tiles) => bytes_of((tiles.tile_size.0, tiles.tile_size.1)),
        BlockDescription::ScanLines => bytes_of((header.layer_size.0, header.compression.scan_lines_per_block())),
    };
    if matches!(header.blocks, BlockDescription::Tiles(_)) && block > image.max(LARGEST_TILE) {
        return Err(Error::Invalid(format!("tiles of {block} bytes in an image of {image} bytes").into()));
    }
    if !can_reserve(block) {
        return Err(Error::Invalid(format!("blocks of {block} bytes, for which there is not enough memory").into()));
    }
    Ok(())
}

/// A block of the DWA compressions begins with the sizes of its sections. The decoder allocates memory of these sizes
/// without a check.
fn check_promises(chunk: &Chunk, meta: &MetaData) -> Result<()> {
    let header = meta.headers.get(chunk.layer_index).ok_or(Error::Invalid("a block of no part".into()))?;
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => return Ok(()),
    };
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let place = header.get_block_data_indices(&chunk.compressed_block)?;
    let size = header.get_absolute_block_pixel_coordinates(place)?.size;
    let [width, height] = [size.0, size.1];
    if bytes.len() == width.saturating_mul(height).saturating_mul(header.channels.bytes_per_pixel) {
        // A block that compression does not shrink is stored uncompressed.
        return Ok(());
    }
    // Coefficients are stored in squares of 8 x 8. No value needs more than four bytes and half as much again.
    let samples = (width.next_multiple_of(8) as u64).saturating_mul(height.next_multiple_of(8) as u64);
    let most = samples.saturating_mul(6 * header.channels.list.len() as u64).max(bytes.len() as u64);
    let sizes = bytes.as_chunks::<8>().0.iter().map(|&b| u64::from_le_bytes(b)).skip(1).take(DWA_SIZES);
    if sizes.max().is_some_and(|size| size > most) {
        return Err(Error::Invalid("a block that is larger than the image".into()));
    }
    Ok(())
}

/// The blocks of the chunks, in their order.
fn decode_blocks(mut chunks: Vec<Chunk>, meta: &MetaData, threads: usize) -> Result<Vec<UncompressedBlock>> {
    let decode = |chunks: Vec<Chunk>| -> Result<Vec<UncompressedBlock>> {
        let blocks = chunks.into_iter().map(|chunk| UncompressedBlock::decompress_chunk(chunk, meta, false));
        guard(|| blocks.collect())
    };
    let share = chunks.len().div_ceil(threads.max(1)).max(1);
    thread::scope(|scope| {
        let mut others = Vec::new();
        while chunks.len() > share {
            let part = chunks.split_off(chunks.len() - share);
            others.push(scope.spawn(|| decode(part)));
        }
        let mut blocks = decode(chunks)?;
        for other in others.into_iter().rev() {
            // A panic is caught within.
            blocks.extend(other.join().unwrap_or(Err(Error::Aborted))?);
        }
        Ok(blocks)
    })
}

/// Runs third-party code on arbitrary bytes. A panic in it is an error.
pub(super) fn guard<T>(read: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or(Err(Error::Invalid("the decoder cannot read its data".into())))
}
