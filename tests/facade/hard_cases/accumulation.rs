//! Family 8, accumulation: ten million samples of one bright pixel, films merged in any order, images of one pixel and of
//! one row.
//!
//! Hard, because a sum in f32 stops growing when a sample is less than half a unit of its last place: after 1.7e7 samples
//! of 1 it stands still, and with a few bright samples far earlier. A sum in f64 keeps growing, but depends on the order in
//! which threads add, so that no two renders agree. And code for images meets widths that are no multiple of a tile, or
//! smaller than a filter.
//!
//! Must give: the exact mean, as computed here in whole numbers; the same bits for every order and every grouping of
//! merges; and a full image of any shape, with every pixel right.

use super::support::spot;
use crate::support::{build, emitter, film, settings, square};
use dunkelfeld::film::{Accumulate, Film, PixelSums, Sample};
use dunkelfeld::geometry::DVec3;
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Scene, SceneBuilder};
use dunkelfeld_adaptive::weights::Strategy;

/// A deterministic stream of radiances: mostly near one, one in a thousand a million times as bright. Whole multiples of
/// 2^-10, so that sums are exact in whole numbers.
fn radiance(i: u32) -> (f32, u64) {
    let h = u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    let units = if h % 1000 == 0 { (h % 4096 + 1) << 20 } else { h % 4096 };
    (units as f32 / 1024.0, units)
}

fn sample(v: f32) -> Sample {
    Sample { radiance: Rgb::new(v, 2.0 * v, 0.5 * v), ..Sample::MISS }
}

#[test]
fn ten_million_samples_of_a_bright_pixel_have_their_exact_mean() {
    let mut pixel = PixelSums::default();
    let mut units = 0u128;
    const N: u32 = 10_000_000;
    for i in 0..N {
        let (v, u) = radiance(i);
        units += u128::from(u);
        pixel.add(i, &sample(v));
    }
    let exact = units as f64 / 1024.0 / f64::from(N);
    for (mean, factor) in pixel.mean().into_iter().zip([1.0, 2.0, 0.5]) {
        // Three roundings to f64 on the way out: the sum, the division, the comparison.
        assert!((mean / (factor * exact) - 1.0).abs() < 4.0 * f64::EPSILON, "{mean} instead of {}", factor * exact);
    }
    assert_eq!((pixel.count(), pixel.invalid), (N, 0));
    // The sum in f32 of the same stream, to verify that this is a hard case.
    let naive = (0..N).fold(0f32, |sum, i| sum + radiance(i).0) / N as f32;
    assert!((f64::from(naive) / exact - 1.0).abs() > 1e-4, "a sum in f32 is as good: {naive}, {exact}");
}

#[test]
fn films_merge_to_the_same_bits_in_any_order_and_grouping() {
    // 32 parts of a film of 5 x 3 pixels, unequal in size, merged forward, backward, shuffled, in pairs.
    const PARTS: usize = 32;
    let mut parts = [[PixelSums::default(); 15]; PARTS];
    let mut whole = [PixelSums::default(); 15];
    for pixel in 0..15usize {
        for i in 0..5_000u32 {
            let s = sample(radiance(i.wrapping_add(pixel as u32 * 77_777)).0 * 1.1);
            let part = (i as usize * i as usize / 7 + pixel) % PARTS;
            parts[part][pixel].add(i, &s);
            whole[pixel].add(i, &s);
        }
    }
    let film = |sums: &[PixelSums]| {
        let mut film = Film::new(5, 3);
        film.add_rows(0, sums).expect("memory");
        film
    };
    let (parts, whole) = (parts.map(|sums| film(&sums)).to_vec(), film(&whole));
    let merged = |order: &[usize]| {
        let mut film = Film::new(5, 3);
        order.iter().for_each(|&i| film.merge(&parts[i]).expect("same size"));
        film
    };
    let forward: Vec<usize> = (0..PARTS).collect();
    let backward: Vec<usize> = (0..PARTS).rev().collect();
    let shuffled: Vec<usize> = (0..PARTS).map(|i| i * 13 % PARTS).collect();
    for order in [&forward, &backward, &shuffled] {
        assert!(merged(order) == whole, "merged in the order {order:?}");
    }
    let mut layer = parts.clone();
    while layer.len() > 1 {
        layer = layer
            .chunks(2)
            .map(|pair| {
                let mut a = pair[1].clone();
                a.merge(&pair[0]).expect("same size");
                a
            })
            .collect();
    }
    assert!(layer[0] == whole, "merged in pairs");
}

/// A lamp of radiance (1, 2, 3) that fills the view of any shape.
fn lamp() -> Scene {
    let mut b = SceneBuilder::default();
    let mut material = emitter(1.0);
    material.emission = Rgb::new(1.0, 2.0, 3.0);
    let m = b.add_material(material);
    b.add_object("lamp", square(0.0, 1.0, false), m);
    spot(&mut b, DVec3::Z, DVec3::ZERO, 1e-5);
    build(b)
}

#[test]
fn images_of_one_pixel_and_of_one_row_are_whole() {
    let scene = lamp();
    for (width, height) in [(1, 1), (16_384, 1), (1, 16_384), (17, 1), (16_383, 2)] {
        for strategy in [Strategy::Uniform, Strategy::Sobel] {
            for spp in [1.0, 5.0] {
                let s = settings(width, height, spp, 3).with_strategy(strategy);
                let film = film(&scene, &s);
                let what = format!("{width} x {height}, {strategy:?}, {spp} samples per pixel");
                assert_eq!((film.width(), film.height()), (width, height));
                assert_eq!(film.total_samples(), u64::from(width * height) * spp as u64, "{what}");
                assert!(film.mean().data().iter().all(|p| *p == [1.0, 2.0, 3.0]), "{what}");
                assert_eq!(film.invalid_samples(), 0, "{what}");
            }
        }
    }
}

#[test]
fn every_place_of_a_long_row_is_where_it_should_be() {
    // The left half of a row of 16 384 pixels shows the lamp, the right half nothing; the pixel in the middle no mixture.
    let mut b = SceneBuilder::default();
    let m = b.add_material(emitter(1.0));
    b.add_object("lamp", super::support::moved(square(0.0, 2.0, false), DVec3::X * -1.0), m);
    b.cameras.push(dunkelfeld::scene::Camera {
        name: "row".into(),
        to_world: dunkelfeld::scene::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y),
        projection: dunkelfeld::scene::Projection::Orthographic { half_width: 1.0, half_height: 1e-6 },
        ..dunkelfeld::scene::Camera::default()
    });
    let film = film(&build(b), &settings(16_384, 1, 4.0, 3));
    for (x, p) in film.mean().data().iter().enumerate() {
        let expected = if x < 8_192 { 1.0 } else { 0.0 };
        // Film positions near x = 8192 are known to half a thousandth of a pixel.
        assert!(p[0] == expected || (8_191..=8_192).contains(&x), "pixel {x}: {p:?}");
    }
}
