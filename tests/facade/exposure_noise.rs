//! Exposure whose noise is matched: what it depends on, and where it holds. `tests/cli/ptc.rs` has the photon transfer of rendered
//! frames.
//!
//! Replay: `cargo test -p dunkelfeld --test it exposure_noise::NAME`.

use crate::support::{rendered, sensor, settings, shadow};
use dunkelfeld::film::{Accumulate, Film, PixelSums, Plane, Sample};
use dunkelfeld::outputs::encode_layers;
use dunkelfeld::radiometry::{Electrons, Rgb};
use dunkelfeld::sensor::{Device, ExposureNoise, FrameKey};
use dunkelfeld::{Frame, RenderSettings, RenderedFilm, Rendering, SensorChoice, Session, develop, develop_film};
use dunkelfeld_integrator::PixelIds;
use dunkelfeld_io::layers::Single;
use dunkelfeld_sampling::hash_u64;

const SIDE: u32 = 96;
const FRAMES: u32 = 48;

/// Exposed for so many milliseconds.
fn exposed(ms: f64) -> RenderSettings {
    settings(SIDE, SIDE, 64.0, 5).with_sensor(sensor("imx250", Some(ms))).with_exposure_noise(ExposureNoise::Matched)
}

fn developed(rendering: &Rendering, settings: &RenderSettings) -> Frame {
    develop_film(&rendering.film, settings).expect("a frame")
}

/// An even surface of which now and then a sample is 200 times as bright: in one pixel of a hundred, which it lifts by
/// 2.5 standard deviations of the camera. In the other pixels the frames must scatter as the camera does, although
/// their neighbourhood has met such samples in half of the frames.
///
/// The variance rests on 3000 pixels times 47 degrees of freedom: a standard error of 0.4 %. The bar of 2 % is five of
/// them, and the control lies twice as far away.
#[test]
fn a_rare_sample_is_not_compensated_by_its_neighbours() {
    const SAMPLES: u32 = 64;
    let settings = exposed(1.0).with_width(64).with_height(48);
    let pixels = 64 * 48;
    let ids = Plane::new(64, 48, Some(PixelIds::new(0, 0)));
    let SensorChoice::Emva { model, exposure: Some(exposure), .. } = &settings.sensor else { panic!("a sensor") };
    let mean = 400.0;
    let per_radiance = {
        let white = develop(&Plane::new(64, 48, [1.0; 3]), &settings).expect("a frame");
        f64::from(white.sensor.expect("a sensor").electrons.data()[0])
    };
    let camera = model.temporal_variance(Electrons(mean), exposure.time());
    // A fifth of the camera's variance, from samples that are evenly distributed.
    let spread = (0.2 * camera * f64::from(SAMPLES) * 12.0).sqrt();
    let rare = 2.5 * camera.sqrt() * f64::from(SAMPLES);
    let chance = 0.01 / f64::from(SAMPLES);
    assert!(0.5 * spread < mean, "samples are not negative");

    let device = Device::new((**model).clone(), settings.seed, 64, 48).expect("no maps");
    // Frames without a rare sample, sums of grey values and of squares: as it is exposed, and with all variance left
    // out.
    let mut sums = vec![[[0.0f64; 3]; 2]; pixels];
    for frame in 0..FRAMES {
        let mut sums_of_frame = vec![PixelSums::default(); pixels];
        for (pixel, sums) in sums_of_frame.iter_mut().enumerate() {
            for index in 0..SAMPLES {
                let key = [u64::from(frame), pixel as u64, u64::from(index)];
                let [even, event] = [0, 1].map(|i| hash_u64([key[0], key[1], key[2], i]) as f64 * 0.5f64.powi(64));
                let electrons = mean + spread * (even - 0.5) + if event < chance { rare } else { 0.0 };
                let radiance = Rgb::splat((electrons / per_radiance) as f32);
                sums.add(index, &Sample { radiance, hit: true, ..Sample::MISS });
            }
        }
        let mut film = Film::new(64, 48);
        film.add_rows(0, &sums_of_frame).expect("memory");
        let settings = settings.clone().with_frame(frame);
        let sensor = develop_film(&film_of(film, &ids), &settings).expect("a frame").sensor.expect("a sensor");
        let ratios = &sensor.certified.as_ref().expect("certified").ratios;
        let mut others = Plane::new(64, 48, 0u16);
        let variance = ratios.map(|r| r * camera as f32);
        let key = FrameKey { seed: settings.seed, frame };
        device
            .expose_rows_matched(&sensor.electrons, &variance, *exposure, key, 0..48, others.data_mut())
            .expect("a frame");
        let known = sensor.matched.as_ref().expect("matched").ratios.data();
        for (i, sums) in sums.iter_mut().enumerate().filter(|(i, _)| known[*i].is_finite()) {
            for (sums, values) in sums.iter_mut().zip([&sensor.values, &others]) {
                let value = f64::from(values.data()[i]);
                *sums = [sums[0] + 1.0, sums[1] + value, sums[2] + value * value];
            }
        }
    }
    let gain = model.spec().system_gain;
    let [found, without_the_rule] = [0, 1].map(|which| {
        let of = |[n, sum, squares]: [f64; 3]| (squares - sum * sum / n) / (n - 1.0);
        sums.iter().map(|s| of(s[which])).sum::<f64>() / pixels as f64 / (gain * gain * camera)
    });
    let counted = sums.iter().map(|s| s[0][0]).sum::<f64>() / pixels as f64 / f64::from(FRAMES);
    assert!((counted - 0.99).abs() < 0.003, "{counted} of all pixels have met no rare sample");
    assert!((found - 1.0).abs() < 0.02, "{found} of the camera's variance");
    assert!(without_the_rule < 0.96, "{without_the_rule}: neighbours do not matter here");
}

/// A film that shows the objects of these ids.
fn film_of(sums: Film, ids: &Plane<Option<PixelIds>>) -> RenderedFilm {
    RenderedFilm { ids: ids.clone(), ..RenderedFilm::without_ids(sums) }
}

/// The small image of the tests below.
fn small() -> RenderSettings {
    exposed(0.15).with_width(40).with_height(30)
}

fn plain(settings: &RenderSettings) -> RenderSettings {
    settings.clone().with_exposure_noise(ExposureNoise::Plain)
}

fn values(frame: &Frame) -> &Plane<u16> {
    &frame.sensor.as_ref().expect("a sensor").values
}

#[test]
fn matched_frames_depend_on_the_film_alone_and_state_where_they_hold() {
    let scene = shadow();
    let settings = small();
    let rendering = rendered(&scene, &settings);
    let frame = developed(&rendering, &settings);
    let one = settings.clone().running(|run| run.with_threads(1));
    let again = Session::new(1).expect("a thread").install(|| developed(&rendered(&scene, &one), &one));
    assert_eq!(values(&frame), values(&again));

    let layers = |frame: &Frame, settings| encode_layers(&rendering.film, frame, settings);
    let matched = frame.sensor.as_ref().and_then(|s| s.matched.as_ref()).expect("matched");
    let with = layers(&frame, &settings);
    let layer = with.single(Single::Matched).expect("a layer");
    let held = layer.data().iter().filter(|&&v| v == 1.0).count();
    assert!(layer.data().iter().all(|&v| v == 0.0 || v == 1.0));
    assert_eq!(held, matched.held.data().iter().filter(|h| **h).count());
    assert!((matched.share - held as f64 / 1200.0).abs() < 1e-12, "{}", matched.share);
    assert!(matched.share > 0.5 && matched.share < 1.0, "{}: a share without information", matched.share);

    // All but the grey values is as in a plain exposure: mean, variance, electrons, certificate.
    let other = developed(&rendering, &plain(&settings));
    assert_ne!(values(&frame), values(&other));
    let (a, b) = (frame.sensor.as_ref().expect("a sensor"), other.sensor.as_ref().expect("a sensor"));
    assert!(b.matched.is_none());
    assert_eq!((&a.electrons, &a.certified, a.exposure), (&b.electrons, &b.certified, b.exposure));
    let without = layers(&other, &plain(&settings));
    assert_eq!(with.channels.iter().filter(|(name, _)| name != "matched.Y").collect::<Vec<_>>(), {
        without.channels.iter().collect::<Vec<_>>()
    });
}

/// Pixels without samples, with one sample, and with so many that they have variances of their own.
#[test]
fn a_pixel_whose_variance_is_not_known_is_exposed_as_ever_and_does_not_count() {
    let scene = shadow();
    let number = |x: u32, y: u32| match (x + y) % 3 {
        0 => 64,
        other => other - 1,
    };
    let settings = small().running(|run| run.with_replay(Plane::from_fn(40, 30, number)));
    let rendering = rendered(&scene, &settings);
    let frame = developed(&rendering, &settings);
    let other = developed(&rendering, &plain(&settings));
    let held = &frame.sensor.as_ref().and_then(|s| s.matched.as_ref()).expect("matched").held;
    let (mut known, mut changed) = (0, 0);
    for y in 0..30 {
        for x in 0..40 {
            if number(x, y) == 64 {
                known += u32::from(*held.at(x, y));
                changed += u32::from(values(&frame).at(x, y) != values(&other).at(x, y));
            } else {
                assert!(!held.at(x, y), "{x}, {y}: held with {} samples", number(x, y));
                assert_eq!(values(&frame).at(x, y), values(&other).at(x, y), "{x}, {y}");
            }
        }
    }
    // 400 pixels have samples; more than half of them are lit.
    assert!(known > 200 && changed > 40, "{known} held, {changed} other grey values");

    // Of a mean alone nothing is known.
    let mean = rendering.film.sums.mean_without_gaps();
    let vague = develop(&mean, &settings).expect("a frame").sensor.expect("a sensor");
    assert_eq!(&vague.values, values(&other));
    let matched = vague.matched.expect("it was to be matched");
    assert_eq!((matched.share, matched.held), (0.0, Plane::new(40, 30, false)));
}
