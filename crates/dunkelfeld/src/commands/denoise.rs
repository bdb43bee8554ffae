//! `denoise`: adds a denoised layer to an EXR of ours or of another renderer, or converts it to a picture.

use crate::denoising::{Denoised, find_denoiser, run};
use crate::guard::check_outputs;
use crate::memory::{MemoryAccount, denoise_account};
use crate::outputs::{attributes, denoised_by, extension, misfit, save_exr, set_attribute};
use derive_setters::Setters;
use dunkelfeld_denoise::{Builtin, DenoiseError, DenoiseInput, Denoiser};
use dunkelfeld_film::{Plane, fill_gaps};
use dunkelfeld_io::InputError;
use dunkelfeld_io::exr::{ExrLayers, ExrSize, read_exr_if};
use dunkelfeld_io::input::{InputFiles, Role};
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_io::picture::Picture;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_render::Error;
use dunkelfeld_render::Session;
use dunkelfeld_render::{DenoiseMethod, DenoiseSettings, written};
use dunkelfeld_sensor::display::linear_to_8bit;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Maximum number of channel names in a message.
const MAX_LISTED: usize = 12;
/// The advice where the memory is too small.
const SMALLER: &str = "denoise a smaller image, one with fewer layers, or with the denoiser `builtin`";
/// A picture of the radiances for a sensor has this quantile of the luminance at this share of white.
const BRIGHT: (f64, f32) = (0.995, 0.9);

/// An EXR, and its denoised image.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct DenoisedFile {
    /// The content of the file, without an older denoised layer.
    pub layers: ExrLayers,
    /// The denoised image.
    pub denoised: Denoised,
    /// The inputs of the denoiser beside the mean: `variance`, `first light`, `albedo`, `normal`, `depth`.
    pub features: Vec<&'static str>,
    /// Pixels whose radiance was negative, infinite or not a number. The denoised values of these pixels and of those
    /// around them are undefined.
    pub invalid: u64,
    /// Pixels whose variance was negative or not a number. Such a variance counts as unknown.
    pub invalid_variances: u64,
    path: PathBuf,
    inputs: InputFiles,
}

/// The inputs of a denoiser: planes of one size. All but the mean are optional.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_", into)]
#[non_exhaustive]
pub struct DenoisePlanes {
    /// Mean radiance [W/(m^2 sr)], linear Rec. 709.
    pub mean: Plane<[f32; 3]>,
    /// Variance of the mean, the square of its unit.
    pub variance: Option<Plane<[f32; 3]>>,
    /// The part of the mean that is first light [W/(m^2 sr)].
    pub first_light: Option<Plane<[f32; 3]>>,
    /// Mean albedo of the first surface.
    pub albedo: Option<Plane<[f32; 3]>>,
    /// Variance of the mean albedo.
    pub albedo_variance: Option<Plane<[f32; 3]>>,
    /// Mean unit normal of the first surface.
    pub normal: Option<Plane<[f32; 3]>>,
    /// Variance of the mean normal.
    pub normal_variance: Option<Plane<[f32; 3]>>,
    /// Mean depth of the first surface \[m\].
    pub depth: Option<Plane<f32>>,
    /// Variance of the mean depth \[m^2\].
    pub depth_variance: Option<Plane<f32>>,
}

/// Denoises an EXR. Returns `None` if it was cancelled. `threads` is the number of threads; 0 means one per core.
/// `memory_limit` is the limit of memory \[bytes\].
///
/// # Errors
/// A file that cannot be read or holds no radiance, a denoiser that is not to be had or fails.
pub fn denoise_exr(
    path: &Path,
    settings: &DenoiseSettings,
    memory_limit: Option<u64>,
    session: &Session<'_>,
) -> Result<Option<DenoisedFile>, Error> {
    let denoiser = needed_denoiser(settings)?;
    let mut inputs = InputFiles::new();
    inputs.add_library(settings.oidn.as_deref());
    let agree = |size: ExrSize| {
        account_of(&*denoiser, (size.width, size.height), size.bytes, session).check(memory_limit, 0, SMALLER)
    };
    let mut layers = read_exr_if(path, Role::Image, &mut inputs, agree)?;
    let planes = DenoisePlanes::from_layers(path, &layers)?;
    let is_radiance = |v: &f32| v.is_finite() && *v >= 0.0;
    let invalid = planes.mean.data().iter().filter(|v| !v.iter().all(is_radiance)).count() as u64;
    let invalid_variances = planes.variance.as_ref().map_or(0, invalid_variances_of);
    let features = [
        ("variance", planes.variance.is_some()),
        ("first light", planes.first_light.is_some()),
        ("albedo", planes.albedo.is_some()),
        ("normal", planes.normal.is_some()),
        ("depth", planes.depth.is_some()),
    ];
    let features = features.into_iter().filter_map(|(name, there)| there.then_some(name)).collect();
    let Some(denoised) = planes.denoised(&*denoiser, session)? else { return Ok(None) };
    layers.remove_triples(Triple::Denoised);
    Ok(Some(DenoisedFile { layers, denoised, features, invalid, invalid_variances, path: path.into(), inputs }))
}

/// Denoises planes of any program: [`denoise_exr`] without a file.
///
/// # Errors
/// Planes of different sizes, a denoiser that is not to be had or fails, and more memory than `memory_limit` \[bytes\].
pub fn denoise_planes(
    planes: &DenoisePlanes,
    settings: &DenoiseSettings,
    memory_limit: Option<u64>,
    session: &Session<'_>,
) -> Result<Option<Denoised>, Error> {
    planes.check()?;
    let denoiser = needed_denoiser(settings)?;
    let size = (planes.mean.width(), planes.mean.height());
    account_of(&*denoiser, size, planes.bytes(), session).check(memory_limit, 0, SMALLER)?;
    planes.denoised(&*denoiser, session)
}

fn needed_denoiser(settings: &DenoiseSettings) -> Result<Box<dyn Denoiser>, Error> {
    let problem = "there is nothing to do without a denoiser";
    find_denoiser(settings)?.ok_or_else(|| Error::setting("denoise", problem, "choose another than `off`"))
}

fn account_of(denoiser: &dyn Denoiser, size: (u32, u32), bytes: u64, session: &Session<'_>) -> MemoryAccount {
    let method = if denoiser.name() == Builtin.name() { DenoiseMethod::Builtin } else { DenoiseMethod::Oidn };
    denoise_account(size, bytes, method, session.threads())
}

/// Checks before the work whether the result can be written: the extension, the folder, and that the output is neither
/// the input nor the library of the settings.
///
/// # Errors
/// The fault of the name.
pub fn check_denoise_output(input: &Path, output: &Path, settings: &DenoiseSettings) -> Result<(), Error> {
    let mut inputs = InputFiles::new();
    inputs.add(input, Role::Image);
    inputs.add_library(settings.oidn.as_deref());
    check_output(output, &inputs)
}

fn check_output(output: &Path, inputs: &InputFiles) -> Result<(), Error> {
    let fault = |problem: String, help: &str| Err(Error::Output { file: output.into(), problem, help: help.into() });
    if !["exr", "png"].contains(&extension(output).as_str()) {
        let problem = misfit(output);
        return fault(problem, "end it in .exr for all layers, or in .png for a picture");
    }
    check_outputs(&[("the denoised image", output)], inputs)?;
    written(output, dunkelfeld_io::atomic::check_writable(output))
}

impl DenoisedFile {
    /// Writes the result: as EXR with all layers, windows and primaries of the input and `denoised.R/G/B`, or the display
    /// window as 8-bit PNG with gamma 2.2.
    /// Radiance 1 is white in the picture, as in other programs. The radiances of a render for a sensor have a unit;
    /// then the picture is scaled so that the bright parts are near white.
    ///
    /// # Errors
    /// If the file cannot be written, or a PNG would have other primaries than Rec. 709; an existing file then stays as it
    /// was.
    pub fn save(self, output: &Path) -> Result<(), Error> {
        check_output(output, &self.inputs)?;
        let mut layers = self.layers;
        if extension(output) == "png" {
            layers.check_primaries(&self.path)?;
            let scale = match attributes(&layers).get("sensor") {
                Some(serde_json::Value::String(_)) => brightness(&self.denoised.mean),
                _ => 1.0,
            };
            layers.channels.clear();
            layers.push_triples(Triple::Denoised, &self.denoised.mean);
            let mean = layers.displayed().triples(Triple::Denoised).unwrap_or(self.denoised.mean);
            let picture = linear_to_8bit(&mean.map(|v| v.map(|v| v * scale)));
            let mut comment = denoised_by(&self.denoised.denoiser);
            if scale != 1.0 {
                comment += &format!("; white is a radiance of {:e} W/(m^2 sr)", 1.0 / scale);
            }
            let text = [("Software", "Dunkelfeld"), ("Comment", comment.as_str())];
            return written(output, dunkelfeld_io::png::write_png(output, Picture::Rgb8(&picture), &text));
        }
        set_attribute(&mut layers, "denoiser", &self.denoised.denoiser);
        layers.push_triples(Triple::Denoised, &self.denoised.mean);
        save_exr(output, layers)
    }
}

impl DenoisePlanes {
    /// The mean alone.
    pub fn new(mean: Plane<[f32; 3]>) -> Self {
        let (albedo, albedo_variance, normal, normal_variance) = (None, None, None, None);
        let (variance, first_light, depth, depth_variance) = (None, None, None, None);
        Self { mean, variance, first_light, albedo, albedo_variance, normal, normal_variance, depth, depth_variance }
    }

    /// Sizes of the other planes with their names.
    fn others(&self) -> impl Iterator<Item = (&'static str, [u32; 2], u64)> {
        let triples = [
            ("variance", &self.variance),
            ("first_light", &self.first_light),
            ("albedo", &self.albedo),
            ("albedo_variance", &self.albedo_variance),
            ("normal", &self.normal),
            ("normal_variance", &self.normal_variance),
        ];
        let singles = [("depth", &self.depth), ("depth_variance", &self.depth_variance)];
        let triples = triples.into_iter().filter_map(|(name, plane)| Some((name, size_of_plane(plane.as_ref()?), 12)));
        triples.chain(singles.into_iter().filter_map(|(name, plane)| Some((name, size_of_plane(plane.as_ref()?), 4))))
    }

    fn check(&self) -> Result<(), Error> {
        let [width, height] = size_of_plane(&self.mean);
        let help = "pass planes of one size, with at least one pixel";
        if width == 0 || height == 0 {
            return Err(Error::setting("mean", "has no pixels", help));
        }
        match self.others().find(|(_, size, _)| *size != [width, height]) {
            Some((name, [w, h], _)) => {
                let problem = format!("has {w} x {h} pixels, and the mean {width} x {height}");
                Err(Error::setting(name, problem, help))
            }
            None => Ok(()),
        }
    }

    fn bytes(&self) -> u64 {
        let pixels = self.mean.data().len() as u64;
        pixels * self.others().map(|(_, _, bytes)| bytes).sum::<u64>() + 12 * pixels
    }

    /// `None` if it was cancelled.
    fn denoised(&self, denoiser: &dyn Denoiser, session: &Session<'_>) -> Result<Option<Denoised>, Error> {
        let began = Instant::now();
        match session.install(|| run(&self.input(), denoiser, 0, session)) {
            Ok(mean) => {
                let (denoiser, seconds) = (denoiser.name(), began.elapsed().as_secs_f64());
                Ok(Some(Denoised { mean, denoiser, seconds }))
            }
            Err(DenoiseError::Cancelled) if session.is_cancelled() => Ok(None),
            Err(e) => {
                let help = "choose another denoiser, or a smaller image";
                Err(Error::setting(denoiser.name(), e.to_string(), help))
            }
        }
    }

    fn from_layers(path: &Path, layers: &ExrLayers) -> Result<Self, InputError> {
        let mean = radiance_of(path, layers, None)?;
        Ok(Self {
            mean,
            variance: layers.triples(Triple::Variance),
            first_light: layers.triples(Triple::FirstLight),
            albedo: layers.triples(Triple::Albedo),
            albedo_variance: layers.triples(Triple::AlbedoVariance),
            normal: layers.triples(Triple::Normal),
            normal_variance: layers.triples(Triple::NormalVariance),
            depth: layers.single(Single::Depth),
            depth_variance: layers.single(Single::DepthVariance),
        })
    }

    pub(crate) fn input(&self) -> DenoiseInput<'_> {
        DenoiseInput {
            mean: &self.mean,
            variance: self.variance.as_ref(),
            first_light: self.first_light.as_ref(),
            albedo: self.albedo.as_ref(),
            albedo_variance: self.albedo_variance.as_ref(),
            normal: self.normal.as_ref(),
            normal_variance: self.normal_variance.as_ref(),
            depth: self.depth.as_ref(),
            depth_variance: self.depth_variance.as_ref(),
        }
    }
}

fn size_of_plane<T>(plane: &Plane<T>) -> [u32; 2] {
    [plane.width(), plane.height()]
}

/// Pixels with a variance that is negative or not a number.
pub(crate) fn invalid_variances_of(variance: &Plane<[f32; 3]>) -> u64 {
    variance.data().iter().filter(|v| v.iter().any(|v| v.is_nan() || *v < 0.0)).count() as u64
}

/// The radiance of a file: the layer with that name, or the first name that renderers use. Gaps without samples are
/// filled from their neighbours.
///
/// # Errors
/// There is no such layer.
pub(crate) fn radiance_of(path: &Path, layers: &ExrLayers, name: Option<&str>) -> Result<Plane<[f32; 3]>, InputError> {
    let found = match name {
        Some(name) => layers.triples_named(name),
        None => layers.triples(Triple::Mean),
    };
    let Some(mean) = found else {
        let mut names: Vec<&str> = layers.channels.iter().map(|(name, _)| name.as_str()).collect();
        let more = names.len().saturating_sub(MAX_LISTED);
        names.truncate(MAX_LISTED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let list = format!("the channels are {}{more}", names.join(", "));
        return Err(match name {
            None => {
                let help = "use an image with channels R, G, B, or Combined.R, Combined.G, Combined.B";
                InputError::new(
                    path,
                    "the layer of radiance",
                    format!("is not there under any known name; {list}"),
                    help,
                )
            }
            Some(name) => {
                let help = "name what stands before .R, .G and .B in the names of three of them";
                InputError::new(path, format!("the layer `{name}`"), format!("is not there; {list}"), help)
            }
        });
    };
    // Pixels without samples must not be black.
    Ok(match layers.integers(Single::SampleCount) {
        Some(counts) if counts.data().contains(&0) => fill_gaps(&mean, &counts.map(|&n| n > 0)),
        _ => mean,
    })
}

/// The factor that scales the bright parts of an image to near white.
fn brightness(mean: &Plane<[f32; 3]>) -> f32 {
    let mut values: Vec<f32> = mean.data().iter().map(|&[r, g, b]| Rgb::new(r, g, b).luminance()).collect();
    if values.is_empty() {
        return 1.0;
    }
    let at = ((values.len() - 1) as f64 * BRIGHT.0) as usize;
    let (_, bright, _) = values.select_nth_unstable_by(at, f32::total_cmp);
    let scale = BRIGHT.1 / *bright;
    if *bright > 0.0 && scale.is_normal() { scale } else { 1.0 }
}
