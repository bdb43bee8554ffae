//! A lens that blurs: its image, the noise behind it, the files. `crates/camera/sensor/tests/it/lens_blur.rs` compares the blur itself with
//! closed forms.
//!
//! Replay: `cargo test -p dunkelfeld --test it lens_image::NAME`.

use crate::support::{self, settings, shadow};
use dunkelfeld::film::Plane;
use dunkelfeld::radiometry::Seconds;
use dunkelfeld::scene::Scene;
use dunkelfeld::sensor::{Exposure, Optics, Psf};
use dunkelfeld::{ExposeSettings, Frame, RenderSettings, Rendering, SensorChoice, develop_film, find_sensor};

const SIDE: u32 = 32;

fn exposed(psf: Psf, samples: f64, ms: f64) -> RenderSettings {
    let optics = Optics::new(8.0, 0.9, 0.0).expect("in range").with_psf(psf);
    let model = Box::new(find_sensor("imx250").expect("a preset"));
    let exposure = Exposure::new(Seconds(ms * 1e-3)).expect("in range");
    settings(SIDE, SIDE, samples, 5).with_sensor(SensorChoice::Emva { model, optics, exposure: Some(exposure) })
}

fn rendered(scene: &Scene, settings: &RenderSettings) -> (Rendering, Frame) {
    let rendering = support::rendered(scene, settings);
    let frame = develop_film(&rendering.film, settings).expect("a frame");
    (rendering, frame)
}

fn electrons(frame: &Frame) -> &Plane<f32> {
    &frame.sensor.as_ref().expect("a sensor").electrons
}

/// The noise of the electrons behind the lens over frames with other samples is that of the certificates, on average over the
/// image: for pixels, and for the means of blocks.
///
/// 100 frames of 1024 pixels: a standard error below 1 %, and of 4 % for the 16 blocks.
#[test]
fn the_noise_behind_a_lens_is_that_of_the_certificate() {
    let scene = shadow();
    let frames = 100;
    let (mut claimed, mut sums) = (0.0, vec![[0.0f64; 2]; (SIDE * SIDE) as usize]);
    let mut hidden = 0.0;
    for frame in 0..frames {
        let settings = exposed(Psf::Diffraction, 16.0, 1.0).with_frame(frame);
        let (_, frame) = rendered(&scene, &settings);
        let sensor = frame.sensor.as_ref().expect("a sensor");
        let certified = sensor.certified.as_ref().expect("certified");
        hidden += certified.certificate.hidden_blocks.expect("it blurs") / f64::from(frames);
        let floor = sensor.model.temporal_variance(dunkelfeld::radiometry::Electrons(0.0), sensor.exposure.time());
        for ((sum, &e), &ratio) in sums.iter_mut().zip(electrons(&frame).data()).zip(certified.ratios.data()) {
            let e = f64::from(e);
            *sum = [sum[0] + e, sum[1] + e * e];
            claimed += f64::from(ratio) * (e + floor) / f64::from(frames);
        }
    }
    let n = f64::from(frames);
    let measured: f64 = sums.iter().map(|[sum, squares]| (squares - sum * sum / n) / (n - 1.0)).sum();
    let ratio = measured / claimed;
    assert!((0.95..1.05).contains(&ratio), "{ratio}");
    assert!((0.0..=1.0).contains(&hidden), "{hidden}");
}

/// The EXR of a render is exposed to the same grey values, and through other lenses without new samples.
#[test]
fn an_exr_behind_a_lens_has_the_values_of_the_render() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let scene = shadow();
    let settings = exposed(Psf::Diffraction, 16.0, 1.0);
    let (rendering, frame) = rendered(&scene, &settings);
    let layers = dunkelfeld::outputs::encode_layers(&rendering.film, &frame, &settings);
    dunkelfeld::outputs::save_exr(&path, layers).expect("written");
    let of_render = ExposeSettings::of_render(&settings).expect("valid").expect("a sensor");
    let exposer = dunkelfeld::Exposer::open(&path, &of_render).expect("exposed");
    let values = exposer.frame(0).expect("a frame");
    assert_eq!(values.data(), frame.sensor.as_ref().expect("a sensor").values.data());
    // The lens of the file is used if none is given.
    let mut open = of_render.clone();
    open.of_image = dunkelfeld::commands::OfImage { sensor: true, lens: [true; 3], blur: [true; 2] };
    assert_eq!(
        dunkelfeld::Exposer::open(&path, &open).expect("exposed").frame(0).expect("a frame").data(),
        values.data()
    );
    let sharp = of_render.with_optics(Optics::new(8.0, 0.9, 0.0).expect("in range"));
    assert_ne!(
        dunkelfeld::Exposer::open(&path, &sharp).expect("exposed").frame(0).expect("a frame").data(),
        values.data()
    );
}

/// The film of a sharp lens has no moments, and neither has its EXR when glare comes later.
#[test]
fn glare_behind_a_sharp_lens_is_that_of_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let (rendering, _) = rendered(&shadow(), &exposed(Psf::None, 16.0, 1.0));
    let mut settings = exposed(Psf::None, 16.0, 1.0);
    if let SensorChoice::Emva { optics, .. } = &mut settings.sensor {
        *optics = optics.clone().with_glare(0.2).expect("in range");
    }
    let frame = develop_film(&rendering.film, &settings).expect("a frame");
    let layers = dunkelfeld::outputs::encode_layers(&rendering.film, &frame, &settings);
    assert!(!layers.channels.iter().any(|(name, _)| name.starts_with("moment")));
    dunkelfeld::outputs::save_exr(&path, layers).expect("written");
    let settings = ExposeSettings::of_render(&settings).expect("valid").expect("a sensor");
    let values = dunkelfeld::Exposer::open(&path, &settings).expect("exposed").frame(0).expect("a frame");
    assert_eq!(values.data(), frame.sensor.as_ref().expect("a sensor").values.data());
}
