//! The flags of `emva`.

use crate::choices::one_of;
use crate::run_args::RunArgs;
use crate::values::{whole, within};
use clap::builder::TypedValueParser;
use clap::{Args, Subcommand};
use dunkelfeld::io::Time;
use dunkelfeld::sensor::FilterColor;
use dunkelfeld_studies::emva::{EXPOSURES, PIXEL_PITCHES, Vary, WAVELENGTHS};
use dunkelfeld_studies::emva1288::Release;
use std::path::PathBuf;

/// Flags of `emva`.
#[derive(Debug, Args)]
pub(crate) struct EmvaArgs {
    #[command(subcommand)]
    pub(crate) command: EmvaCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum EmvaCommand {
    /// Take the frames of an EMVA 1288 measurement with a simulated camera, and write them as a data set, with the truth beside
    /// them.
    Dataset(DatasetArgs),
    /// Analyse a data set, of a simulated or a real camera: print all figures with their standard errors, and write a report.
    #[command(alias = "analyze")]
    Analyse(AnalyseArgs),
}

/// Flags of `emva dataset`.
///
/// The folder is written completely or not at all. It contains `emva.txt`, the descriptor in the format of the standard's reference
/// implementation (PyPI emva1288), the frames as PNG, and `truth.json`.
#[derive(Debug, Args)]
pub(crate) struct DatasetArgs {
    /// Sensor preset or a sensor file (.toml).
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) sensor: String,
    /// The folder of the data set; it must not exist yet, or be empty.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Levels of light, each a pair of frames, evenly spread; the last three are saturated.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = within(10..=1000u32))]
    pub(crate) levels: u32,
    /// Size of the frames in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size)]
    pub(crate) size: [u32; 2],
    /// Wavelength of the light in nm [default: that of the highest quantum efficiency].
    #[arg(long, value_name = "NM", value_parser = wavelength)]
    pub(crate) wavelength: Option<f64>,
    /// Frames in each of the stacks, in the dark and at half of saturation.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = within(3..=1000u32))]
    pub(crate) spatial: u32,
    /// The quantity that changes from level to level.
    #[arg(long, default_value = "exposure", value_parser = varied())]
    pub(crate) vary: Vary,
    /// The exposure time, or the longest of them.
    #[arg(long, value_name = "TIME", default_value = "100ms", value_parser = exposure_time)]
    pub(crate) exposure: f64,
    /// Bits per grey value instead of those of the sensor; gain and black level change with them. 8 bits are written as 8-bit PNG.
    #[arg(long, value_name = "N", value_parser = within(8..=16u32))]
    pub(crate) bit_depth: Option<u32>,
    /// Colour of the measured pixels of a sensor with colour filters: a data set has pixels of one colour.
    #[arg(long, value_parser = colors())]
    pub(crate) color: Option<FilterColor>,
    /// Seed of the device and of its noise.
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = whole::<u64>)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Flags of `emva analyse`.
///
/// Reads the frames one at a time: the memory does not depend on their number. If a data set cannot be analysed, the command
/// prints the missing part and ends with exit code 2. If it suffices for an analysis but not for the standard, it is
/// analysed, and notes list the differences.
#[derive(Debug, Args)]
pub(crate) struct AnalyseArgs {
    /// The descriptor: a text with lines `v`, `n`, `b`, `d` and `i`, as in the standard's reference implementation.
    #[arg(value_name = "DESCRIPTOR")]
    pub(crate) input: PathBuf,
    /// Release of the standard that defines saturation: 4.0, where 0.1 to 0.2 % of the values are the largest; 3.1, the peak of the variance.
    #[arg(long, default_value = "4.0", value_parser = releases())]
    pub(crate) release: Release,
    /// The general module, for cameras that are not linear or that process their frames: no gain and no quantum efficiency, but
    /// noise, threshold and range at the input.
    #[arg(long)]
    pub(crate) general: bool,
    /// Distance of the pixels in um, for figures per area and for --sensor.
    #[arg(long, value_name = "UM", value_parser = pitch)]
    pub(crate) pixel_pitch: Option<f64>,
    /// Wavelength of the light in nm, for --sensor.
    #[arg(long, value_name = "NM", value_parser = wavelength)]
    pub(crate) wavelength: Option<f64>,
    /// Write the measured camera as a sensor file, for the key `model` of a job. It needs --pixel-pitch and --wavelength.
    #[arg(long, value_name = "FILE.toml", value_parser = sensor_path)]
    pub(crate) sensor: Option<PathBuf>,
    /// With --sensor, also write maps of DSNU, PRNU and flat field (FILE-dsnu.tif, FILE-prnu.tif, FILE-flat.tif; 32-bit
    /// floats), which the sensor file names: the simulated camera then has these pixels.
    #[arg(long, requires = "sensor")]
    pub(crate) maps: bool,
    /// All results, and the numbers of the plots.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) json: Option<PathBuf>,
    /// The report: one page with the figures and the standard's plots, that needs no other file.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) html: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The varied quantity.
fn varied() -> impl TypedValueParser<Value = Vary> {
    let exposure = "The exposure time, under constant light; it also gives the dark current";
    let irradiance = "The light, at one exposure time";
    one_of(vec![("exposure", Vary::Exposure, exposure), ("irradiance", Vary::Irradiance, irradiance)], Vary::Exposure)
}

/// Colours of filters.
fn colors() -> impl TypedValueParser<Value = FilterColor> {
    one_of(FilterColor::ALL.map(|color| (color.name(), color, "")).to_vec(), FilterColor::Red)
}

/// Releases of the standard.
fn releases() -> impl TypedValueParser<Value = Release> {
    one_of(vec![("4.0", Release::R40, "Of 2021"), ("3.1", Release::R31, "Of 2016")], Release::R40)
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides
        .filter(|sides| sides.iter().all(|s| (16..=dunkelfeld::limits::MAX_SIDE).contains(s)))
        .ok_or_else(|| format!("write width and height, 16 to {}, as in 640x480", dunkelfeld::limits::MAX_SIDE))
}

fn sensor_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_toml = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("toml"));
    if is_toml { Ok(path) } else { Err("name a file that ends in .toml, such as mine.toml".into()) }
}

fn wavelength(text: &str) -> Result<f64, String> {
    let number = text.trim_end_matches("nm").trim().parse().ok();
    number.filter(|v| WAVELENGTHS.contains(v)).ok_or("write a number from 100 to 20000, such as 545".into())
}

pub(super) fn pitch(text: &str) -> Result<f64, String> {
    let number = text.trim_end_matches("um").trim().parse().ok();
    number.filter(|v| PIXEL_PITCHES.contains(v)).ok_or("write a number from 0.1 to 1000, such as 3.45".into())
}

fn exposure_time(text: &str) -> Result<f64, String> {
    let time = text.parse::<Time>().map(f64::from).map_err(|e| e.to_string())?;
    if EXPOSURES.contains(&time) { Ok(time) } else { Err("write a time from 1us to 100000s, such as 100ms".into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_checked_before_any_file_is_opened() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        assert_eq!((wavelength("545nm"), pitch("3.45")), (Ok(545.0), Ok(3.45)));
        assert!(exposure_time("100ms").is_ok_and(|t| (t - 0.1).abs() < 1e-12));
        for bad in ["640", "8x8", "640x", "x480", "-1x5", "axb", "99999999x16"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        for bad in ["0", "nan", "inf", "-3", "green", ""] {
            assert!(wavelength(bad).is_err() && pitch(bad).is_err() && exposure_time(bad).is_err(), "{bad}");
        }
    }
}
