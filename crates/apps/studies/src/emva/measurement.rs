//! Reads a data set frame by frame. The statistics of a frame are kept, the frame is not.

use dunkelfeld::film::Plane;
use dunkelfeld::{Error, Session, Stage};
use dunkelfeld_emva1288::{AnalysisError, Frame, FramePair, Level, Measurement, StackAccumulator, StackLevel};
use dunkelfeld_io::InputError;
use dunkelfeld_io::emva_descriptor::{EmvaDescriptor, FrameBlock, read_descriptor};
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::loader::Limits;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A data set, reduced to the statistics of its frames.
#[derive(Clone, Debug)]
pub struct ReadMeasurement {
    /// The descriptor.
    pub file: PathBuf,
    /// The measurement.
    pub measurement: Measurement,
    /// Width and height of the frames.
    pub size: [u32; 2],
    /// Number of frames.
    pub frames: usize,
    /// The unknown parts of the descriptor.
    pub warnings: Vec<String>,
}

/// The statistics of a block of frames.
enum Seen {
    Pair(Level),
    Stack(StackLevel),
}

/// Reads the data set of a descriptor, on the given number of threads (0: one per core). Each thread uses two frames,
/// and there are two stacks: the memory does not depend on the number of frames. `None` if it was cancelled.
///
/// # Errors
/// A file that cannot be read, frames that differ in size from each other or from the descriptor.
pub fn read_measurement(path: &Path, session: &Session<'_>) -> Result<Option<ReadMeasurement>, Error> {
    let (descriptor, warnings) = read_descriptor(path)?;
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let reader =
        Reader { path, folder, size: size_of_frames(path, &descriptor)?, bits: descriptor.format.map(|f| f.bits) };
    let frames: usize = descriptor.blocks.iter().map(|b| b.frames.len()).sum();
    let done = AtomicUsize::new(0);
    let see = |block: &FrameBlock| -> Result<Option<Seen>, Error> {
        let step = || {
            let fraction = (done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / frames.max(1) as f64;
            session.report_share(Stage::Load, fraction);
            !session.is_cancelled()
        };
        reader.see(block, step)
    };
    let seen: Vec<Option<Seen>> =
        session.install(|| descriptor.blocks.par_iter().map(see).collect::<Result<_, _>>())?;
    let mut measurement = Measurement { bits: reader.bits, ..Measurement::default() };
    for seen in seen {
        match seen {
            None => return Ok(None),
            Some(Seen::Pair(level)) => measurement.levels.push(level),
            Some(Seen::Stack(stack)) => measurement.stacks.push(stack),
        }
    }
    Ok(Some(ReadMeasurement { file: path.to_path_buf(), measurement, size: reader.size, frames, warnings }))
}

/// The descriptor's size, or else that of the first frame.
fn size_of_frames(path: &Path, descriptor: &EmvaDescriptor) -> Result<[u32; 2], Error> {
    if let Some(format) = descriptor.format {
        return Ok([format.width, format.height]);
    }
    let first = descriptor.blocks.iter().flat_map(|b| &b.frames).next();
    let Some(first) = first else {
        let help = "list the frames of each block with lines `i PATH`";
        return Err(InputError::new(path, "data set", "there are no frames in it", help).into());
    };
    let frame = read_gray(&path.parent().unwrap_or(Path::new("")).join(first), &Limits::default())?;
    Ok([frame.values.width(), frame.values.height()])
}

struct Reader<'a> {
    path: &'a Path,
    folder: PathBuf,
    size: [u32; 2],
    bits: Option<u32>,
}

impl Reader<'_> {
    /// Processes the frames of a block: two frames as a pair, more frames one after the other. `step` is called after
    /// each frame, and returns whether to continue.
    fn see(&self, block: &FrameBlock, step: impl Fn() -> bool) -> Result<Option<Seen>, Error> {
        let (exposure, photons) = (1e-9 * block.exposure_ns, block.photons);
        let [width, height] = self.size;
        let unfit = |e: AnalysisError| {
            Error::from(InputError::new(self.path, format!("block in line {}", block.line), e.to_string(), e.help()))
        };
        if let [first, second] = block.frames.as_slice() {
            let a = self.frame(first)?;
            if !step() {
                return Ok(None);
            }
            let b = self.frame(second)?;
            let view = |p| Frame::new(width, height, p).map_err(unfit);
            let pair = FramePair::from_frames(view(a.data())?, view(b.data())?).map_err(unfit)?;
            return Ok(step().then_some(Seen::Pair(Level { exposure, photons, pair })));
        }
        // Memory is allocated for the size of the first frame, not for that of the descriptor.
        let mut stack: Option<StackAccumulator> = None;
        for name in &block.frames {
            let frame = self.frame(name)?;
            let stack = stack.get_or_insert_with(|| StackAccumulator::new(width, height));
            stack.add(Frame::new(width, height, frame.data()).map_err(unfit)?).map_err(unfit)?;
            if !step() {
                return Ok(None);
            }
        }
        let stack = stack.unwrap_or_else(|| StackAccumulator::new(0, 0));
        let stack = stack.finish().map_err(unfit)?;
        Ok(Some(Seen::Stack(StackLevel { exposure, photons, stack })))
    }

    fn frame(&self, name: &Path) -> Result<Plane<u16>, Error> {
        let path = self.folder.join(name);
        let frame = read_gray(&path, &Limits::default())?;
        let (width, height) = (frame.values.width(), frame.values.height());
        let error = |problem: String, help: &str| Err(InputError::new(&path, "frame", problem, help).into());
        if [width, height] != self.size {
            let [w, h] = self.size;
            return error(
                format!("it has {width} x {height} pixels, the data set {w} x {h}"),
                "use frames of one size, that of the line `n BITS WIDTH HEIGHT`",
            );
        }
        if let Some(bits) = self.bits
            && let Some(largest) = frame.values.data().iter().max().filter(|v| u32::from(**v) >> bits.min(16) > 0)
        {
            return error(
                format!("it holds the value {largest}, which is too large for {bits} bits"),
                "correct the line `n BITS WIDTH HEIGHT`, or store values right-aligned: 12 bits end at 4095",
            );
        }
        Ok(frame.values)
    }
}
