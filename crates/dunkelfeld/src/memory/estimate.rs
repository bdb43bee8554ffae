//! Memory of commands in bytes, by their pixels, layers and threads. The bytes per pixel are those of the planes that
//! exist at the same time. `docs/memory.md` compares them with measurements.

use super::MemoryAccount;
use crate::outputs::OutputPaths;
use dunkelfeld_film::{Film, FilmLayers, PixelSums};
use dunkelfeld_integrator::PixelIds;
use dunkelfeld_render::{DenoiseMethod, UNKNOWN_SPP};
use dunkelfeld_render::{RenderSettings, SensorChoice};
use dunkelfeld_scene::SceneSummary;
use dunkelfeld_sensor::ExposureNoise;

/// Maximum number of frames that wait for the writer.
pub(crate) const MAX_WAITING: usize = 16;

/// The program, its libraries and small objects.
const PROGRAM: u64 = 24_000_000;
/// A training path: its vertices, and its share of the learned statistics.
const TRAINING_PATH: u64 = 1000;
/// A thread: the used part of its stack, and the memory that its allocator keeps.
const THREAD: u64 = 2 << 20;
/// Pixels of a tile; a thread has two tiles in work.
const TILE_PIXELS: u64 = (dunkelfeld_render::TILE * dunkelfeld_render::TILE) as u64;
/// A strip of an EXR, its blocks before they are written, and their sources: the maximum in bytes.
const EXR_MOST: u64 = 3 * (32 << 20);
/// The same for a small image, in bytes per pixel: 36 channels.
const EXR_CHANNELS: u64 = 3 * 36 * 4;
/// Rows of an image whose noise a thread estimates at a time, with the rows of their neighbourhood.
const NOISE_ROWS: u64 = 96;
/// Bytes per pixel of these rows: data that all kinds of pixels of the sensor share, and the estimates of each kind.
/// Sums exist for few rows only.
const NOISE_SHARED: u64 = 40;
const NOISE_ESTIMATES: u64 = 120;
/// Kinds of pixels of a sensor behind a colour filter array.
const MAX_KINDS: u64 = 3;
const SUMS: u64 = size_of::<PixelSums>() as u64;

/// Bytes per pixel of planes, one constant for each group.
mod per_pixel {
    /// Ids at each pixel's centre (8), samples so far (4), weights (4).
    pub(super) const KEPT: u64 = 16;
    /// The plan of a round and its increments (8), work units (1).
    pub(super) const ROUND: u64 = 9;
    /// A plan that is replayed: as read, in the settings of the render, and limited to its samples.
    pub(super) const REPLAY: u64 = 12;
    /// The additional data of a checkpoint: object and material numbers (8).
    pub(super) const CHECKPOINT: u64 = 8;
    /// The mean (12), the mask of pixels with samples (1), and a copy for filling gaps (12).
    pub(super) const MEAN: u64 = 25;
    /// The mean (12) and the denoised mean (12) of a light with a film of its own.
    pub(super) const MEANS_OF_LIGHT: u64 = 24;
    /// The image of a lens that blurs: mean and moments (36), the image behind it (12), and of one channel its spectrum (24) and its
    /// moments (8).
    pub(super) const LENS: u64 = 80;
    /// Signal and counts (8), each pixel's noise from its own samples (12).
    pub(super) const NOISE: u64 = 20;
    /// The image in the channels of the sensor (4), the noise of a sample (4), its sums over rows of neighbours (16). The
    /// forecast needs less.
    pub(super) const PLAN: u64 = 24;
    /// Weights without measured noise: luminance and gradients.
    pub(super) const SOBEL: u64 = 28;
    /// Ratios (4) and saturated pixels (1).
    pub(super) const CERTIFIED: u64 = 5;
    /// These, and quantiles (4).
    pub(super) const CERTIFICATE: u64 = CERTIFIED + 4;
    /// Rare samples and matched variances, during their computation.
    pub(super) const MATCHED: u64 = 13;
    /// Object and material of each pixel of a film.
    pub(super) const IDS: u64 = 8;
    /// An exposure that is kept: mean (12), electrons (4), matched variance (5), device (8), certified values and their
    /// quantiles (9).
    pub(super) const EXPOSURE: u64 = 38;
    /// Electrons (4) and grey values (2), the picture (3).
    pub(super) const FRAME: u64 = 9;
    /// Defects and fixed pattern of the device.
    pub(super) const DEVICE: u64 = 8;
    /// The film's inputs of a denoiser: mean, albedo, normal with variances (72), depth with variance (8), first light
    /// (12).
    pub(super) const FEATURES: u64 = 92;
    /// The built-in filter: variances, averages and result (36). One of them exists twice while tiles are assembled
    /// (12).
    pub(super) const BUILTIN: u64 = 48;
    /// Intel Open Image Denoise: the image and its features, before and after their own filter, and the result (72); the
    /// image in two parts (24).
    pub(super) const OIDN: u64 = 96;
    /// Its internal buffers, an estimate.
    pub(super) const OIDN_BUFFERS: u64 = 600;
    /// A picture or grey values as bytes of a file, raw and compressed.
    pub(super) const PICTURE: u64 = 8;
}
/// Maximum of these buffers: above it, OIDN works in tiles.
const OIDN_MOST: u64 = 3_200_000_000;

/// The memory for writing an EXR, strip by strip.
fn exr_bytes(px: u64) -> u64 {
    px.saturating_mul(EXR_CHANNELS).min(EXR_MOST)
}

fn pixels(width: u32, height: u32) -> u64 {
    u64::from(width) * u64::from(height)
}

/// All inputs of the memory account of a render.
#[derive(Clone, Copy)]
pub(crate) struct RenderNeeds<'a> {
    pub(crate) scene: &'a SceneSummary,
    /// Bytes of the description that is kept for changes, without the texels, which the scene shares.
    pub(crate) description: u64,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) outputs: &'a OutputPaths,
    pub(crate) threads: usize,
    /// Data of films that the program keeps beside the render.
    pub(crate) kept: KeptFilms,
}

/// Copies of its film that a program keeps during a render, and their data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeptFilms {
    /// Copies of the film, each with the ids of its pixels.
    pub films: u64,
    /// Exposures of them ([`Exposer`](crate::Exposer)), each with a mean image and a certificate.
    pub exposures: u64,
    /// Analyses of the noise at the same time.
    pub analyses: u64,
    /// Bytes per pixel of other planes and pictures.
    pub bytes_per_pixel: u64,
}

/// The account of a render. The first returned numbers are the scene and the textures. [`MemoryAccount::check`] takes
/// them as memory that is already in use.
pub(crate) fn render_account(required_samples: RenderNeeds<'_>) -> (u64, MemoryAccount) {
    let RenderNeeds { scene, description, settings, outputs, threads, kept } = required_samples;
    let (width, height) = (settings.width, settings.height);
    let px = pixels(width, height);
    let planes = |bytes: u64| px.saturating_mul(bytes);
    // Until all pixels have the samples of the pilot there is no plan.
    let plans = settings.given_spp().is_none() && settings.expected_spp() > f64::from(settings.pilot_spp);
    let has_sensor = settings.has_sensor();
    let is_matched = settings.exposure_noise == ExposureNoise::Matched;

    let mut account = MemoryAccount::new(&["render", "plan", "expose", "denoise", "write"]);
    let always = |bytes: u64| [bytes; 5];
    let geometry = scene.memory_bytes.saturating_sub(scene.texture_bytes);
    account.add("program", &always(PROGRAM));
    account.add("scene", &always(geometry));
    account.add("textures", &always(scene.texture_bytes));
    account.add("description", &always(description));
    let film =
        Film::expected_bytes(width, height, settings.film_layers(), settings.is_blurred(), settings.expected_spp());
    // One for each group of lights, and one for the lights of no group.
    let groups = settings.run.light_groups.len() as u64;
    // A capture has its own while it is planned for or exposed.
    let of_capture = u64::from(!settings.run.captures.is_empty());
    let of_groups = film.saturating_mul(groups + groups.min(1) + of_capture);
    account.add("film", &always(film));
    account.add("films of lights", &always(of_groups));
    account.add("planes", &always(planes(per_pixel::KEPT)));
    if settings.run.replay.is_some() || settings.run.samples.is_some() {
        account.add("plan", &always(planes(per_pixel::REPLAY)));
    }
    let tiles = 2 * TILE_PIXELS * (size_of::<PixelSums>() as u64 + 8) * threads as u64;
    account.add("rounds", &[planes(per_pixel::ROUND).saturating_add(tiles), 0, 0, 0, 0]);
    account.add("training", &always(TRAINING_PATH * u64::from(settings.training_paths())));
    if settings.run.checkpoint.is_some() {
        let rows = 2 * u64::from(width) * u64::from(dunkelfeld_render::TILE) * SUMS;
        account.add("checkpoint", &[planes(per_pixel::CHECKPOINT).saturating_add(rows), 0, 0, 0, 0]);
    }
    let kinds = match &settings.sensor {
        SensorChoice::Emva { model, .. } if model.spec().quantum_efficiency.filter().is_some() => MAX_KINDS,
        _ => 1,
    };
    let bands = noise_bands(width, height, kinds, threads);
    if kept != KeptFilms::default() {
        account.add("kept films", &always(kept_bytes(kept, px, (film, groups), bands)));
    }
    if plans {
        let noise = if has_sensor {
            planes(per_pixel::NOISE).saturating_add(bands.max(planes(per_pixel::PLAN)))
        } else {
            planes(per_pixel::SOBEL)
        };
        account.add("noise and plan", &[0, planes(per_pixel::MEAN).saturating_add(noise), 0, 0, 0]);
    }
    let frame = planes(per_pixel::FRAME);
    if has_sensor {
        let matched = if is_matched { per_pixel::MATCHED } else { 0 };
        // The mean is freed before the noise is estimated, the device before the certificate.
        let noise = planes(per_pixel::NOISE + matched);
        let stop_on_noise = noise.saturating_add(bands.max(planes(per_pixel::CERTIFICATE)));
        account.add("certificate", &[0, 0, stop_on_noise, planes(per_pixel::CERTIFIED), planes(per_pixel::CERTIFIED)]);
        account.add("exposure", &[0, 0, frame, frame, frame]);
    } else {
        account.add("exposure", &[0, 0, planes(per_pixel::MEAN + per_pixel::FRAME), frame, frame]);
    }
    if settings.is_blurred() {
        account.add("lens", &[0, planes(per_pixel::LENS), planes(per_pixel::LENS), planes(12), planes(12)]);
    }
    let denoiser = denoiser_bytes(px, settings.denoise.method);
    if denoiser > 0 {
        account.add("denoiser", &[0, 0, 0, planes(per_pixel::FEATURES).saturating_add(denoiser), planes(12)]);
    }
    let exr = if outputs.exr.is_some() || outputs.plan.is_some() { exr_bytes(px) } else { 0 };
    account.add("files", &[0, 0, 0, 0, planes(per_pixel::PICTURE).saturating_add(exr)]);
    account.add("threads", &always(THREAD * threads as u64));
    (PROGRAM + scene.memory_bytes + description, account)
}

/// The memory of kept films of so many pixels: of a film and of the number of its groups of lights, and of the estimates of a
/// noise analysis.
fn kept_bytes(kept: KeptFilms, px: u64, (film, groups): (u64, u64), bands: u64) -> u64 {
    let planes = |bytes: u64| px.saturating_mul(bytes);
    let of_groups =
        film.saturating_mul(groups + groups.min(1)).saturating_add(planes(per_pixel::MEANS_OF_LIGHT * groups));
    let films = film.saturating_add(of_groups).saturating_add(planes(per_pixel::IDS)).saturating_mul(kept.films);
    // An exposure with factors on the lights has a film of its own.
    let weighted = film.saturating_mul(groups.min(1));
    let exposures = planes(per_pixel::EXPOSURE).saturating_add(weighted).saturating_mul(kept.exposures);
    let analyses = planes(per_pixel::NOISE).saturating_add(bands).saturating_mul(kept.analyses);
    [exposures, analyses, planes(kept.bytes_per_pixel)].into_iter().fold(films, u64::saturating_add)
}

/// The account of a merge of parts of that size.
pub(crate) fn merge_account((width, height): (u32, u32), outputs: &OutputPaths, threads: usize) -> MemoryAccount {
    let px = pixels(width, height);
    let planes = |bytes: u64| px.saturating_mul(bytes);
    let mut account = MemoryAccount::new(&["read", "expose", "write"]);
    account.add("program", &[PROGRAM; 3]);
    let film = Film::expected_bytes(width, height, FilmLayers::All, false, UNKNOWN_SPP);
    account.add("film", &[film.saturating_mul(2), film, film]);
    // Numbers of objects and materials, of the whole and of a part with its bytes; then labels and weights with them.
    account.add("planes", &[planes(24), planes(24), planes(24)]);
    let bands = noise_bands(width, height, MAX_KINDS, threads);
    let stop_on_noise = per_pixel::NOISE + per_pixel::CERTIFICATE + per_pixel::MATCHED + per_pixel::DEVICE;
    account.add("certificate", &[0, planes(stop_on_noise).saturating_add(bands), planes(per_pixel::CERTIFIED)]);
    account.add("exposure", &[0, planes(per_pixel::FRAME), planes(per_pixel::FRAME)]);
    let exr = if outputs.exr.is_some() { exr_bytes(px) } else { 0 };
    account.add("files", &[0, 0, planes(per_pixel::PICTURE).saturating_add(exr)]);
    account.add("threads", &[THREAD * threads as u64; 3]);
    account
}

/// The account of the exposure of an image, from the bytes of its channels.
pub(crate) fn expose_account(
    size: (u32, u32),
    channel_bytes: u64,
    (is_matched, blurs): (bool, bool),
    threads: usize,
) -> MemoryAccount {
    let px = pixels(size.0, size.1);
    let planes = |bytes: u64| px.saturating_mul(bytes);
    let mut account = MemoryAccount::new(&["read", "expose"]);
    account.add("program", &[PROGRAM; 2]);
    account.add("layers", &[channel_bytes.saturating_mul(2), channel_bytes]);
    // Radiance (12), and with its noise: variances and estimates.
    let noise = if is_matched { 160 } else { 0 };
    account.add("radiance", &[0, planes(12 + noise)]);
    // The lens of a file is not known yet; its moments are channels of it.
    account.add("lens", &[0, if blurs { planes(per_pixel::LENS) } else { 0 }]);
    let frames = per_pixel::FRAME + per_pixel::PICTURE;
    let at_once = (threads as u64).clamp(1, MAX_WAITING as u64);
    account.add("exposure", &[0, planes(4 + per_pixel::DEVICE)]);
    account.add("frames", &[0, planes(frames).saturating_mul(at_once)]);
    account.add("threads", &[THREAD * threads as u64; 2]);
    account
}

/// The account of the denoising of an image, from the bytes of its channels.
pub(crate) fn denoise_account(
    size: (u32, u32),
    channel_bytes: u64,
    method: DenoiseMethod,
    threads: usize,
) -> MemoryAccount {
    let px = pixels(size.0, size.1);
    let mut account = MemoryAccount::new(&["read", "denoise", "write"]);
    account.add("program", &[PROGRAM; 3]);
    account.add("layers", &[channel_bytes.saturating_mul(2), channel_bytes, channel_bytes]);
    let features = px.saturating_mul(per_pixel::FEATURES);
    account.add("denoiser", &[0, features.saturating_add(denoiser_bytes(px, method)), px.saturating_mul(24)]);
    account.add("files", &[0, 0, exr_bytes(px)]);
    account.add("threads", &[THREAD * threads as u64; 3]);
    account
}

/// Planes and buffers of a denoiser, without its input features.
fn denoiser_bytes(px: u64, method: DenoiseMethod) -> u64 {
    match method {
        DenoiseMethod::Off => 0,
        DenoiseMethod::Builtin => px.saturating_mul(per_pixel::BUILTIN),
        DenoiseMethod::Auto | DenoiseMethod::Oidn => {
            let buffers = px.saturating_mul(per_pixel::OIDN_BUFFERS).min(OIDN_MOST);
            px.saturating_mul(per_pixel::OIDN).saturating_add(buffers)
        }
    }
}

/// Rows whose noise is estimated at a time.
fn noise_bands(width: u32, height: u32, kinds: u64, threads: usize) -> u64 {
    let rows = u64::from(height).min(NOISE_ROWS.saturating_mul(threads as u64));
    let sums = u64::from(Film::TILE) * SUMS * threads as u64;
    u64::from(width) * (rows * (NOISE_SHARED + kinds * NOISE_ESTIMATES) + sums)
}

const _: () = assert!(size_of::<Option<PixelIds>>() == 8);

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn account_of(settings: &RenderSettings, outputs: &OutputPaths) -> MemoryAccount {
        let scene = SceneSummary { memory_bytes: 5_000_000, texture_bytes: 3_000_000, ..SceneSummary::default() };
        render_account(RenderNeeds {
            scene: &scene,
            description: 0,
            settings,
            outputs,
            threads: 2,
            kept: KeptFilms::default(),
        })
        .1
    }

    fn with(change: impl FnOnce(&mut RenderSettings, &mut OutputPaths)) -> MemoryAccount {
        let (mut settings, mut outputs) = (RenderSettings::without_sensor(), OutputPaths::default());
        change(&mut settings, &mut outputs);
        account_of(&settings, &outputs)
    }

    #[test]
    fn the_largest_film_is_accounted_for_without_overflow() {
        let vast = with(|s, o| {
            (s.width, s.height) = (u32::MAX, u32::MAX);
            s.denoise.method = DenoiseMethod::Oidn;
            o.exr = Some(PathBuf::from("a.exr"));
        });
        assert!(vast.peak_bytes > 1 << 62);
        for account in [
            merge_account((u32::MAX, u32::MAX), &OutputPaths::default(), 64),
            expose_account((u32::MAX, u32::MAX), u64::MAX, (true, true), 64),
            denoise_account((u32::MAX, u32::MAX), u64::MAX, DenoiseMethod::Oidn, 64),
        ] {
            assert!(account.peak_bytes > 1 << 62, "{}", account.table());
        }
    }
}
