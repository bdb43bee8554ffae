//! `dunkelfeld mtf`: the MTF of a camera from frames of a slanted edge.

use super::emva_args::pitch;
use crate::outcome::{Outcome, print};
use clap::Args;
use dunkelfeld::Error;
use dunkelfeld::outputs::save_text;
use dunkelfeld_studies::mtf::{check_table, line_pairs, mtf_of_frames, mtf_table};
use std::fmt::Write;
use std::path::PathBuf;

/// Flags of `mtf`.
#[derive(Debug, Args)]
pub(crate) struct MtfArgs {
    /// Frames of one straight edge between an even dark and an even bright area, 2 to 15 degrees off the rows or columns: grey
    /// PNG, TIFF or BMP with linear values, as `expose --linear` writes them. The noise of several frames is averaged.
    #[arg(value_name = "FRAME", required = true)]
    pub(crate) frames: Vec<PathBuf>,
    /// Distance of the pixels in um.
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub(crate) pixel_pitch: f64,
    /// The part of the frames with the edge: left, top, width and height in pixels [default: the whole frame].
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    pub(crate) roi: Option<Region>,
    /// Write the MTF of the lens alone, without that of the pixel: a table for the key `psf` of a job.
    #[arg(short = 'o', long = "output", value_name = "LENS.csv")]
    pub(crate) output: Option<PathBuf>,
}

/// Left, top, width and height.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Region([u32; 4]);

fn region(text: &str) -> Result<Region, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let region = numbers.and_then(|numbers| <[u32; 4]>::try_from(numbers).ok());
    region.map(Region).ok_or_else(|| "write left, top, width and height, as in 100,80,200,160".into())
}

pub(crate) fn run(args: &MtfArgs) -> Result<Outcome, Error> {
    if let Some(output) = &args.output {
        check_table(&args.frames, output)?;
    }
    let edge = mtf_of_frames(&args.frames, args.roi.map(|Region(region)| region))?;
    let axis = if edge.is_horizontal { "rows" } else { "columns" };
    let mut text = format!("edge tilted by {:.2} degrees against the {axis} of pixels\n", edge.angle);
    text += "cycles/pixel   lp/mm  camera  +-      lens\n";
    for p in edge.points.iter().filter(|p| p.error.is_finite()) {
        let at = line_pairs(p.frequency, args.pixel_pitch);
        let _ = writeln!(text, "{:12.2}  {at:6.1}  {:.4}  {:.4}  {:.4}", p.frequency, p.camera, p.error, p.lens);
    }
    text += &match edge.mtf50 {
        None => "MTF50 of the camera: above 0.5 cycles/pixel\n".into(),
        Some([at, error]) => {
            let of = |f| line_pairs(f, args.pixel_pitch);
            format!(
                "MTF50 of the camera: {at:.4} +- {error:.4} cycles/pixel, {:.1} +- {:.1} lp/mm\n",
                of(at),
                of(error)
            )
        }
    };
    if let Some(output) = &args.output {
        save_text(output, &mtf_table(&edge, args.pixel_pitch))?;
        text += &format!("wrote {}\n", output.display());
    }
    print(&text);
    Ok(Outcome::Done)
}
