//! The results of the facade: layers with the values of the film.
//!
//! Replay: `cargo test -p dunkelfeld --test it outputs::NAME`.

use crate::support::{Add, build, emitter, rendered, sensor, settings, spot_camera, square};
use dunkelfeld::film::Plane;
use dunkelfeld::geometry::DVec3;
use dunkelfeld::limits::DEFAULT_SENSOR;
use dunkelfeld::outputs::encode_layers;
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Material, Scene, SceneBuilder};
use dunkelfeld::{Picture, develop};
use dunkelfeld_io::layers::{Single, Triple};

/// Half of the view shows a lit floor, 2 m below the camera; the other half shows nothing.
fn floor_and_void() -> Scene {
    let mut b = SceneBuilder::default();
    b.add(
        "floor",
        square(0.0, 1.0, false),
        Material { base_color: Rgb::new(0.8, 0.4, 0.2).into(), ..Material::default() },
    );
    b.add("lamp", square(3.0, 1.0, true), emitter(5.0));
    spot_camera(&mut b, DVec3::new(0.5, 0.0, 2.0), DVec3::new(0.5, 0.0, 0.0), 0.25);
    build(b)
}

#[test]
fn layers_hold_what_the_film_and_the_sensor_hold() {
    let scene = floor_and_void();
    let s = settings(16, 12, 8.0, 3).with_sensor(sensor(DEFAULT_SENSOR, None));
    let rendering = rendered(&scene, &s);
    let frame = develop(&rendering.film.sums.mean(), &s).expect("exposed");
    let layers = encode_layers(&rendering.film, &frame, &s);

    assert_eq!(layers.triples(Triple::Mean), Some(rendering.film.sums.mean()));
    assert_eq!(layers.triples(Triple::Variance), Some(rendering.film.sums.variance()));
    assert_eq!(layers.triples(Triple::Covariance), Some(rendering.film.sums.covariance()));
    assert_eq!(layers.integers(Single::SampleCount), Some(Plane::new(16, 12, 8)));
    let sensor = frame.sensor.expect("there is one");
    assert_eq!(layers.single(Single::Electrons), Some(sensor.electrons.clone()));

    // The picture keeps the order of the grey values.
    let Picture::Gray(picture) = frame.picture else { panic!("a monochrome sensor") };
    let values = sensor.values.data();
    let mut pairs: Vec<_> = values.iter().zip(picture.data()).collect();
    pairs.sort_unstable();
    assert!(pairs.windows(2).all(|w| w[0].1 <= w[1].1) && pairs[0].1 < pairs[191].1);
    assert_eq!(sensor.saturated, values.iter().filter(|v| **v == sensor.model.max_value()).count() as f64 / 192.0);
}
