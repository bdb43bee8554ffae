//! Writes a data set: every frame as an image, the descriptor, the truth. The folder is written completely or not at
//! all.

use super::plan::{DatasetPlan, Shot};
use super::truth::Truth;
use dunkelfeld::film::Plane;
use dunkelfeld::{Error, Session, Stage};
use dunkelfeld_io::emva_descriptor::{EmvaDescriptor, FrameBlock, FrameFormat, write_descriptor};
use dunkelfeld_io::new_folder::NewFolder;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::write_png;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Name of the descriptor in the folder of a data set.
pub const DESCRIPTOR: &str = "emva.txt";
/// Name of the file with the truth.
pub const TRUTH: &str = "truth.json";

/// The written files.
#[derive(Clone, Debug, PartialEq)]
pub struct WrittenDataset {
    /// The descriptor.
    pub descriptor: PathBuf,
    /// Number of frames.
    pub frames: u32,
    /// The expected result of an analysis.
    pub truth: Truth,
}

/// Simulates all frames of a plan and writes them into a new folder, on the given number of threads (0: one per core).
/// The frames do not depend on it. `None` if it was cancelled: then no file remains.
///
/// # Errors
/// The folder is not empty, cannot be written, or another process writes into it.
pub fn write_dataset(
    plan: &DatasetPlan,
    folder: &Path,
    session: &Session<'_>,
) -> Result<Option<WrittenDataset>, Error> {
    let output = |e: std::io::Error| Error::Output {
        file: folder.to_path_buf(),
        problem: e.to_string(),
        help: "name a folder that does not exist yet, on a disk with room".into(),
    };
    let begun = NewFolder::start(folder)?;
    let narrow = plan.device().model().spec().bit_depth <= 8;
    let frames: Vec<(usize, u32)> =
        plan.shots().iter().enumerate().flat_map(|(i, s)| (0..s.frames).map(move |k| (i, k))).collect();
    let done = AtomicU32::new(0);
    let take = |&(index, number): &(usize, u32)| -> Result<(), Error> {
        if session.is_cancelled() {
            return Ok(());
        }
        let Some(shot) = plan.shots().get(index) else { return Ok(()) };
        let values = plan.frame(shot, number)?;
        let path = begun.file(&frame_name(shot, index, number)).map_err(output)?;
        if narrow {
            let values: Plane<u8> = values.map(|&v| v.min(255) as u8);
            write_png(&path, Picture::Gray8(&values), &[]).map_err(output)?;
        } else {
            write_png(&path, Picture::Gray16(&values), &[]).map_err(output)?;
        }
        let count = done.fetch_add(1, Ordering::Relaxed) + 1;
        session.report_share(Stage::Expose, f64::from(count) / frames.len() as f64);
        Ok(())
    };
    session.install(|| frames.par_iter().try_for_each(take))?;
    if session.is_cancelled() {
        return Ok(None);
    }
    let truth = plan.truth();
    begun.write_text(DESCRIPTOR, &write_descriptor(&descriptor(plan))).map_err(output)?;
    // Plain data with string keys: serialisation cannot fail.
    let text = serde_json::to_string_pretty(&truth).unwrap_or_default() + "\n";
    begun.write_text(TRUTH, &text).map_err(output)?;
    begun.finish().map_err(output)?;
    Ok(Some(WrittenDataset { descriptor: folder.join(DESCRIPTOR), frames: frames.len() as u32, truth }))
}

fn descriptor(plan: &DatasetPlan) -> EmvaDescriptor {
    let bits = plan.device().model().spec().bit_depth;
    let settings = plan.settings();
    let block = |(index, shot): (usize, &Shot)| FrameBlock {
        exposure_ns: (shot.exposure.time().0 * 1e9).round(),
        photons: shot.photons,
        frames: (0..shot.frames).map(|k| PathBuf::from(frame_name(shot, index, k))).collect(),
        line: 0,
    };
    EmvaDescriptor {
        version: Some("4.0".into()),
        format: Some(FrameFormat { bits, width: settings.width, height: settings.height }),
        blocks: plan.shots().iter().enumerate().map(block).collect(),
    }
}

/// `images/b_012_0.png`: bright or dark, number of the shot, number of the frame.
fn frame_name(shot: &Shot, index: usize, number: u32) -> String {
    let kind = if shot.photons > 0.0 { 'b' } else { 'd' };
    format!("images/{kind}_{index:03}_{number}.png")
}
