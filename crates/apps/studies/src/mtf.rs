//! The MTF of a camera and its lens, from frames of a slanted edge (ISO 12233).

use dunkelfeld::Error;
use dunkelfeld::guard::check_outputs;
use dunkelfeld::outputs::written;
use dunkelfeld_emva1288::{EdgeMtf, slanted_edge};
use dunkelfeld_io::InputError;
use dunkelfeld_io::atomic::check_writable;
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::loader::Limits;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Checks before frames are read that a table replaces none of them, and can be written.
///
/// # Errors
/// It cannot.
pub fn check_table(frames: &[PathBuf], table: &Path) -> Result<(), Error> {
    let mut inputs = InputFiles::new();
    frames.iter().for_each(|frame| inputs.add(frame, Role::Frame));
    check_outputs(&[("the MTF", table)], &inputs)?;
    written(table, check_writable(table))
}

/// The MTF from the mean of frames of one edge: PNG, TIFF or BMP with linear grey values. `roi` is the part with the edge:
/// left, top, width, height \[pixels\].
///
/// # Errors
/// A frame that cannot be read, frames of different size, a part outside of them, and those of [`slanted_edge`].
pub fn mtf_of_frames(frames: &[PathBuf], roi: Option<[u32; 4]>) -> Result<EdgeMtf, Error> {
    let refuse = |file: &Path, problem: String, help: &str| Err(InputError::new(file, "frame", problem, help).into());
    let mut first: Option<(&PathBuf, [u32; 2])> = None;
    let (mut sums, mut part) = (Vec::new(), [0; 4]);
    for path in frames {
        let values = read_gray(path, &Limits::default())?.values;
        let size = [values.width(), values.height()];
        let (_, [width, height]) = *first.get_or_insert((path, size));
        if size != [width, height] {
            let problem = format!("it has {} x {} pixels, the first frame {width} x {height}", size[0], size[1]);
            return refuse(path, problem, "use frames of one camera and one edge");
        }
        part = roi.unwrap_or([0, 0, width, height]);
        let [left, top, columns, rows] = part;
        if left.saturating_add(columns) > width || top.saturating_add(rows) > height {
            let problem = format!("it has {width} x {height} pixels, and the region of interest ends outside");
            return refuse(path, problem, "write left, top, width and height of a part of the frame");
        }
        sums.resize(columns as usize * rows as usize, 0.0);
        let rows = values.data().chunks(width as usize).skip(top as usize).take(rows as usize);
        let inside = rows.flat_map(|row| &row[left as usize..(left + columns) as usize]);
        sums.iter_mut().zip(inside).for_each(|(sum, value)| *sum += f64::from(*value) / frames.len() as f64);
    }
    let file = first.map_or(Path::new(""), |(path, _)| path);
    slanted_edge(part[2] as usize, &sums).map_err(|e| InputError::new(file, "frame", e.to_string(), e.help()).into())
}

/// The MTF of the lens alone as the table that the key `psf` of a lens reads. The pixel pitch is in um.
pub fn mtf_table(edge: &EdgeMtf, pixel_pitch: f64) -> String {
    let mut text = format!(
        "# MTF of the lens along the normal of an edge, tilted by {:.2} degrees, without the pixel of {pixel_pitch} um (ISO 12233).\n\
         frequency_lp_mm,mtf\n",
        edge.angle
    );
    for p in &edge.points {
        let _ = writeln!(text, "{:.3},{:.5}", line_pairs(p.frequency, pixel_pitch), p.lens);
    }
    text
}

/// A frequency in cycles per pixel as line pairs per mm on the sensor.
pub fn line_pairs(frequency: f64, pixel_pitch: f64) -> f64 {
    1e3 * frequency / pixel_pitch
}
