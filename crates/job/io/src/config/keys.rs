//! The keys of a job that other front ends set by name: one row gives the flag of the command line with its help, the
//! keyword of Python with its type, and the line of the job file.
//!
//! A front end only writes lines of TOML, which [`Job::with_overrides`](crate::job::Job::with_overrides) merges into
//! the job. So a value has one reader, and the same limits and messages everywhere.

use super::job::Job;
use crate::error::InputError;
use crate::toml_file::TomlFile;

/// What a value is, and so how it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A whole number.
    Whole,
    /// A number.
    Real,
    /// A time with its unit.
    Time,
    /// A time with its unit, or `auto`.
    Exposure,
    /// An amount of memory with its unit.
    Memory,
    /// One of some names, each with its meaning.
    Name(&'static [(&'static str, &'static str)]),
    /// A sensor: a preset, a file, or `none`.
    Sensor,
    /// A length with its unit.
    Length,
    /// The blur of a lens: a word, or a CSV file.
    Psf,
    /// A file that is read. Relative paths are those of the current folder.
    Input,
    /// A file that is written. Relative paths are those of the current folder.
    Output,
}

/// A key that has a flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// Its place in the job: `budget.time`.
    pub path: &'static str,
    /// The flag, without dashes.
    pub flag: &'static str,
    /// The keyword of Python; empty if there is none.
    pub keyword: &'static str,
    /// The name of the value in the help.
    pub value: &'static str,
    /// What the value is.
    pub kind: Kind,
    /// The help text.
    pub help: &'static str,
}

/// All keys with a flag, in the order of the help.
pub const KEYS: &[Key] = &[
    Key {
        path: "output.image",
        flag: "output",
        keyword: "",
        value: "FILE.png",
        kind: Kind::Output,
        help: "The picture: PNG, 8 bit, gamma 2.2, clipped at saturation [default: the input's name with .png, in this \
               folder, or with .render.png where that is an input].",
    },
    Key {
        path: "output.linear",
        flag: "linear",
        keyword: "",
        value: "FILE",
        kind: Kind::Output,
        help: "Linear grey values, 16 bit, .png or .tif (with a sensor).",
    },
    Key {
        path: "output.align",
        flag: "align",
        keyword: "",
        value: "ALIGN",
        kind: Kind::Name(&[
            ("right", "The lowest bits: the number is the grey value, as in Mono12 of GenICam"),
            ("left", "The highest bits: the number is the grey value times a power of two"),
        ]),
        help: "Place of the bits of the grey values in the 16 of --linear [default: right].",
    },
    Key {
        path: "output.exr",
        flag: "exr",
        keyword: "",
        value: "FILE.exr",
        kind: Kind::Output,
        help: "All layers: mean radiance, its variance, samples per pixel, albedo, normal, depth, ids, electrons, the ratio \
               of the noise to that of the sensor, and the pixels with matched exposure.",
    },
    Key {
        path: "output.stats",
        flag: "stats",
        keyword: "",
        value: "FILE.json",
        kind: Kind::Output,
        help: "Statistics of the render.",
    },
    Key {
        path: "output.plan",
        flag: "plan",
        keyword: "",
        value: "FILE.exr",
        kind: Kind::Output,
        help: "The sample plan that was rendered, for --replay.",
    },
    Key {
        path: "film.width",
        flag: "width",
        keyword: "width",
        value: "PIXELS",
        kind: Kind::Whole,
        help: "Width of the image [default: 512].",
    },
    Key {
        path: "film.height",
        flag: "height",
        keyword: "height",
        value: "PIXELS",
        kind: Kind::Whole,
        help: "Height of the image [default: 512].",
    },
    Key {
        path: "budget.time",
        flag: "time",
        keyword: "time",
        value: "TIME",
        kind: Kind::Time,
        help: "Stop after this wall-clock time, start and writing included, as in 20s or 5min. A limit replaces all limits \
               of the job.",
    },
    Key {
        path: "budget.spp",
        flag: "spp",
        keyword: "spp",
        value: "N",
        kind: Kind::Real,
        help: "Stop after this many samples per pixel, on average [default: 64 if there is no other limit].",
    },
    Key {
        path: "budget.noise",
        flag: "noise",
        keyword: "noise",
        value: "K",
        kind: Kind::Real,
        help: "Stop when the noise of the sensor hides that of the render: in 99 % of the unsaturated pixels its standard \
               deviation is at most K times the sensor's, K from 0.001 to 1000. 0.7 makes the noise of both 22 % larger \
               than the sensor's, 0.5 12 %, 0.25 3 %.",
    },
    Key {
        path: "budget.share",
        flag: "share",
        keyword: "share",
        value: "PERCENT",
        kind: Kind::Real,
        help: "The share of the unsaturated pixels at which --noise stops, in per cent, from 1 to 100 [default: 99].",
    },
    Key {
        path: "budget.memory",
        flag: "memory",
        keyword: "memory",
        value: "SIZE",
        kind: Kind::Memory,
        help: "The most memory that the command may need, as in 6GB or 512MiB. The need is computed beforehand; if it is \
               larger, the command ends with its account and exit code 2.",
    },
    Key {
        path: "allocate.strategy",
        flag: "allocate",
        keyword: "strategy",
        value: "STRATEGY",
        kind: Kind::Name(&[
            ("uniform", "The same number everywhere"),
            ("sobel", "In proportion to the Sobel magnitude of a pilot image (Kludt et al.)"),
            ("sensor", "More where the noise of the render is large beside that of the sensor"),
        ]),
        help: "Distribution of the samples [default: sensor; uniform without a sensor].",
    },
    Key {
        path: "sensor.model",
        flag: "sensor",
        keyword: "sensor",
        value: "NAME|FILE|none",
        kind: Kind::Sensor,
        help: "Sensor preset, a sensor file (.toml), or none for a plain image where radiance 1 is white [default: imx250].",
    },
    Key {
        path: "sensor.exposure",
        flag: "exposure",
        keyword: "exposure",
        value: "TIME|auto",
        kind: Kind::Exposure,
        help: "Exposure time as in 5ms, or auto: the 99.5 % quantile comes to 90 % of saturation [default: auto].",
    },
    Key {
        path: "sensor.exposure_noise",
        flag: "exposure-noise",
        keyword: "exposure_noise",
        value: "NOISE",
        kind: Kind::Name(&[
            ("plain", "All of the camera's noise, in addition to that of the render"),
            (
                "matched",
                "The camera's noise less that of the render, so that frames of independent renders have the noise of the \
                 camera. The output states the share of pixels for which that holds; the EXR of a render has it as layer \
                 matched.Y",
            ),
        ]),
        help: "Noise that the exposure adds to that of the render [default: plain].",
    },
    Key {
        path: "lens.f_number",
        flag: "f-number",
        keyword: "f_number",
        value: "N",
        kind: Kind::Real,
        help: "f-number of the lens, 0.5 to 1000 [default: that of the render, if the file contains it; 4].",
    },
    Key {
        path: "lens.transmission",
        flag: "transmission",
        keyword: "transmission",
        value: "SHARE",
        kind: Kind::Real,
        help: "Share of the light that passes the lens, above 0 and at most 1 [default: that of the render; 0.9].",
    },
    Key {
        path: "lens.magnification",
        flag: "magnification",
        keyword: "magnification",
        value: "M",
        kind: Kind::Real,
        help: "Image size over object size, 0 (far away) to 100 [default: that of the render; 0].",
    },
    Key {
        path: "lens.psf",
        flag: "psf",
        keyword: "psf",
        value: "PSF",
        kind: Kind::Psf,
        help: "Blur of the lens: none, diffraction, or a CSV file with its MTF [default: that of the render; none].",
    },
    Key {
        path: "lens.glare",
        flag: "glare",
        keyword: "glare",
        value: "SHARE",
        kind: Kind::Real,
        help: "Share of the light in the veiling glare, 0 to 0.5; real lenses have 0.01 to 0.03 [default: that of the render; \
               0].",
    },
    Key {
        path: "lens.focal_length",
        flag: "focal-length",
        keyword: "focal_length",
        value: "LENGTH",
        kind: Kind::Length,
        help: "Focal length of the lens, as in 12mm: with the sensor's pixel pitch it gives the field angle of each pixel, for \
               --vignetting.",
    },
    Key {
        path: "lens.vignetting",
        flag: "vignetting",
        keyword: "vignetting",
        value: "VIGNETTING",
        kind: Kind::Name(&[
            ("none", "Not at all, as a lens that is corrected for it, or an image after flat-field correction"),
            ("cos4", "With the fourth power of the cosine of the field angle, as a thin lens"),
        ]),
        help: "Vignetting of the lens [default: the job's; none].",
    },
    Key {
        path: "denoise.method",
        flag: "denoise",
        keyword: "denoise",
        value: "DENOISER",
        kind: Kind::Name(&[
            ("off", "No denoiser"),
            ("auto", "Intel Open Image Denoise if this machine has it, else the built-in filter"),
            ("oidn", "Intel Open Image Denoise"),
            ("builtin", "The built-in filter: needs no library, and uses the variance of each pixel"),
        ]),
        help: "Denoiser of the picture [default: off]. No measurement uses the denoised image. The EXR contains it as layer \
               denoised beside the unbiased mean, and the metadata of the picture name the denoiser.",
    },
    Key {
        path: "denoise.oidn",
        flag: "oidn",
        keyword: "oidn",
        value: "PATH",
        kind: Kind::Input,
        help: "Intel Open Image Denoise 1.4 or 2: the library or its folder [default: DUNKELFELD_OIDN, then the usual places \
               of the system]. Without --denoise it means --denoise oidn.",
    },
    Key {
        path: "seed",
        flag: "seed",
        keyword: "seed",
        value: "N",
        kind: Kind::Whole,
        help: "Seed of all random numbers [default: 0].",
    },
    Key {
        path: "frame",
        flag: "frame",
        keyword: "frame",
        value: "N",
        kind: Kind::Whole,
        help: "Frame number: frames of one seed are independent, and come from the same device [default: 0].",
    },
];

/// Flags of a render.
pub const OF_RENDER: &[&str] = &[
    "output",
    "linear",
    "align",
    "exr",
    "stats",
    "plan",
    "width",
    "height",
    "time",
    "spp",
    "noise",
    "share",
    "memory",
    "allocate",
    "sensor",
    "exposure",
    "exposure-noise",
    "vignetting",
    "denoise",
    "oidn",
    "seed",
    "frame",
];
/// Flags of a study, which renders a scene many times.
pub const OF_STUDY: &[&str] = &["width", "height", "memory", "sensor", "exposure", "seed"];
/// Flags of the exposure of an image.
pub const OF_IMAGE: &[&str] = &[
    "output",
    "linear",
    "align",
    "memory",
    "sensor",
    "exposure",
    "exposure-noise",
    "f-number",
    "transmission",
    "magnification",
    "psf",
    "glare",
    "vignetting",
    "focal-length",
    "seed",
    "frame",
];
/// Flags of the lens of an image.
pub const OF_LENS: &[&str] = &["f-number", "transmission", "magnification", "psf", "glare"];
/// Flags of the files that a merge of parts writes.
pub const OF_MERGE: &[&str] = &["output", "linear", "align", "exr", "stats"];
/// Flags that stand for the exposure of a film.
pub const OF_FILM: &[&str] = &["sensor", "exposure", "exposure-noise", "seed", "frame"];

impl Key {
    /// The key of a flag, without dashes.
    pub fn of_flag(flag: &str) -> Option<&'static Self> {
        KEYS.iter().find(|key| key.flag == flag)
    }

    /// The key of a keyword of Python, among those of these flags.
    pub fn of_keyword(keyword: &str, flags: &[&str]) -> Option<&'static Self> {
        KEYS.iter().find(|key| !keyword.is_empty() && key.keyword == keyword && flags.contains(&key.flag))
    }

    /// The line of a job that sets this key to a value that is written as on the command line: `budget.time = "20s"`.
    ///
    /// # Errors
    /// A value that the job may not have.
    pub fn line(&self, value: &str) -> Result<String, InputError> {
        let line = format!("{} = {}\n", self.path, self.literal(value));
        if self.kind == Kind::Sensor && value != "none" && !is_toml(value) {
            crate::sensor_file::preset(value)?;
        }
        // One row is read alone, so its value is checked before any file is opened.
        TomlFile::from_text(format!("--{}", self.flag), format!("scene = \"none\"\n{line}")).parse::<Job>()?;
        Ok(line)
    }

    /// The value in TOML.
    fn literal(&self, value: &str) -> String {
        let absolute = |value: &str| match std::path::absolute(value) {
            Ok(path) => path.to_str().map_or_else(|| value.to_owned(), str::to_owned),
            Err(_) => value.to_owned(),
        };
        let text = match self.kind {
            // TOML has no whole numbers from 2^63 on.
            Kind::Whole => match value.parse::<i64>() {
                Ok(number) if number >= 0 => return number.to_string(),
                _ => value.to_owned(),
            },
            Kind::Real => match value.parse::<f64>() {
                Ok(number) => return toml::Value::Float(number).to_string(),
                Err(_) => value.to_owned(),
            },
            Kind::Input => absolute(value),
            Kind::Sensor if is_toml(value) => absolute(value),
            Kind::Psf if value.to_ascii_lowercase().ends_with(".csv") => absolute(value),
            _ => value.to_owned(),
        };
        toml::Value::String(text).to_string()
    }
}

fn is_toml(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".toml")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_is_a_key_of_the_job() {
        for key in KEYS {
            let value = match key.kind {
                Kind::Whole => "7",
                Kind::Real if ["transmission", "glare"].contains(&key.flag) => "0.25",
                Kind::Real => "7.5",
                Kind::Time | Kind::Exposure => "7s",
                Kind::Memory => "7GB",
                Kind::Length => "7mm",
                Kind::Psf => "lens.csv",
                Kind::Sensor => "mine.toml",
                Kind::Input | Kind::Output => "a \"file\".exr",
                Kind::Name(names) => {
                    for (name, _) in names {
                        assert!(key.line(name).is_ok(), "{} {name}", key.flag);
                    }
                    assert!(key.line("other").is_err(), "{}", key.flag);
                    continue;
                }
            };
            let line = key.line(value).unwrap_or_else(|e| panic!("{}: {e}", key.flag));
            assert!(line.starts_with(key.path), "{line}");
            assert_eq!(KEYS.iter().filter(|other| other.flag == key.flag || other.path == key.path).count(), 1);
        }
    }

    #[test]
    fn values_are_refused_as_in_the_job() {
        let refused = |flag: &str, value: &str| {
            let key = Key::of_flag(flag).expect("a flag");
            key.line(value).expect_err(value).to_string()
        };
        for (flag, value, text) in [
            ("width", "0", "32768"),
            ("width", "-3", "32768"),
            ("spp", "nan", "1e9"),
            ("spp", "many", "number"),
            ("time", "-1s", "20s"),
            ("noise", "1e9", "1000"),
            ("exposure", "0ms", "5ms"),
            ("seed", "-1", "whole number"),
            ("seed", "1.5", "whole number"),
        ] {
            let error = refused(flag, value);
            assert!(error.contains(text) && error.contains(&format!("--{flag}")), "{flag} {value}: {error}");
        }
        let most = u64::MAX.to_string();
        assert_eq!(Key::of_flag("seed").map(|key| key.line(&most)), Some(Ok(format!("seed = \"{most}\"\n"))));
    }
}
