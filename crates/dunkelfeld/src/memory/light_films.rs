//! Memory of films for each light, which a program renders and shows at the same time.

use super::MemoryAccount;
use super::estimate::{MAX_KINDS, PROGRAM, THREAD, TRAINING_PATH, noise_bands, per_pixel};
use dunkelfeld_film::Film;
use dunkelfeld_render::RenderSettings;
use dunkelfeld_scene::SceneSummary;

/// Copies of a film that exist at the same time: the one that is shown, and the next one.
const COPIES: u64 = 2;
/// Bytes per pixel of a copy: ids of object and material (8), its mean (12), the variance of the mean (4).
const OF_COPY: u64 = 24;
/// Bytes per pixel of the analyses of a film that are kept, of two cameras: samples (4), matched variance (5), denoised mean
/// (12).
const ANALYSES: u64 = 2 * 21;
/// Bytes per pixel of the picture: samples now and before (8), combined mean (12).
const OF_PICTURE: u64 = 20;

/// All inputs of the account.
#[derive(Clone, Copy)]
pub(crate) struct LightFilmsNeeds<'a> {
    pub(crate) scene: &'a SceneSummary,
    /// Bytes of the description that is kept for changes, without the texels, which the scene shares.
    pub(crate) description: u64,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) lights: usize,
    pub(crate) threads: usize,
}

/// The account. The first returned number is the memory that is already in use: the scene and its description.
pub(crate) fn light_films_account(needs: LightFilmsNeeds<'_>) -> (u64, MemoryAccount) {
    let LightFilmsNeeds { scene, description, settings, lights, threads } = needs;
    let (width, height, lights) = (settings.width, settings.height, lights as u64);
    let px = u64::from(width) * u64::from(height);
    let planes = |bytes: u64| px.saturating_mul(bytes);
    let films = |bytes: u64| bytes.saturating_mul(lights);
    let mut account = MemoryAccount::new(&["render"]);
    account.add("program", &[PROGRAM]);
    account.add("scene", &[scene.memory_bytes.saturating_sub(scene.texture_bytes)]);
    account.add("textures", &[scene.texture_bytes]);
    account.add("description", &[description]);
    // Meshes with trees of their own, and texels, are shared.
    account.add("scenes of lights", &[films(scene.own_bytes)]);
    let film =
        Film::expected_bytes(width, height, settings.film_layers(), settings.is_blurred(), settings.expected_spp());
    account.add("films", &[films(film)]);
    account.add("copies", &[films(COPIES * film.saturating_add(planes(OF_COPY)))]);
    account.add("planes", &[films(planes(per_pixel::KEPT + per_pixel::ROUND))]);
    account.add("analyses", &[films(planes(ANALYSES))]);
    account.add("training", &[films(TRAINING_PATH * u64::from(settings.training_paths()))]);
    // One film at a time is planned, and one analysed.
    let plan = planes(per_pixel::NOISE + per_pixel::PLAN);
    let certificate = planes(per_pixel::NOISE + per_pixel::CERTIFICATE);
    let bands = noise_bands(width, height, MAX_KINDS, threads);
    account.add("noise and plan", &[plan.saturating_add(certificate).saturating_add(2 * bands)]);
    account.add("exposure", &[planes(OF_PICTURE + per_pixel::FRAME + per_pixel::DEVICE)]);
    account.add("threads", &[films(THREAD * threads as u64)]);
    (PROGRAM + scene.memory_bytes + description, account)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two lights need twice the films of one, and no second scene.
    #[test]
    fn the_memory_grows_by_a_film_with_its_copies_for_each_light() {
        let scene =
            SceneSummary { memory_bytes: 1 << 30, texture_bytes: 1 << 20, own_bytes: 1000, ..Default::default() };
        let settings = crate::default_settings().with_width(1000).with_height(1000);
        let peak = |lights| {
            let needs = LightFilmsNeeds { scene: &scene, description: 500, settings: &settings, lights, threads: 2 };
            let (held, account) = light_films_account(needs);
            assert_eq!(held, PROGRAM + (1 << 30) + 500);
            account.peak_bytes
        };
        let film =
            Film::expected_bytes(1000, 1000, settings.film_layers(), settings.is_blurred(), settings.expected_spp());
        let planes = 1_000_000 * (2 * OF_COPY + per_pixel::KEPT + per_pixel::ROUND + ANALYSES);
        let training = TRAINING_PATH * u64::from(settings.training_paths());
        let of_light = 3 * film + planes + training + 2 * THREAD + 1000;
        assert_eq!(peak(2) - peak(1), of_light);
        assert_eq!(peak(9) - peak(2), 7 * of_light);
        assert!(peak(1) > of_light + (1 << 30));
    }
}
