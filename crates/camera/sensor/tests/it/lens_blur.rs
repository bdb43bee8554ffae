//! The image of a lens against closed forms.

use dunkelfeld_film::{MeanImage, Plane};
use dunkelfeld_radiometry::{Metres, Nanometres};
use dunkelfeld_sensor::{Bands, LensBlur, Optics, Psf};
use std::f64::consts::PI;

const PITCH: Metres = Metres(3.45e-6);
const GREEN: f64 = 550e-9;
const SPREAD: f64 = MeanImage::SPREAD as f64;

fn lens(f_number: f64) -> Optics {
    let bands = Bands { wavelengths: [Nanometres(1e9 * GREEN); 3], ..Bands::default() };
    Optics::new(f_number, 0.9, 0.0).expect("in range").with_bands(bands).with_psf(Psf::Diffraction)
}

/// 2/pi (acos x - x sqrt(1 - x^2)) at a frequency [cycles per pixel].
fn mtf(f_number: f64, [x, y]: [f64; 2]) -> f64 {
    let x = (x.hypot(y) * f_number * GREEN / PITCH.0).min(1.0);
    2.0 / PI * (x.acos() - x * (1.0 - x * x).sqrt())
}

fn sinc(f: f64) -> f64 {
    if f == 0.0 { 1.0 } else { (PI * f).sin() / (PI * f) }
}

/// Integral of x sin(2 pi f x) over a pixel.
fn ramp(f: f64) -> f64 {
    if f == 0.0 { 0.0 } else { (sinc(f) - (PI * f).cos()) / (2.0 * PI * f) }
}

type Image = Plane<[f32; 3]>;

/// An image with or without moments.
fn kind(has_moments: bool) -> MeanImage {
    let pixel = || Plane::new(1, 1, [0.0; 3]);
    MeanImage { radiance: pixel(), moments: has_moments.then(|| [pixel(), pixel()]), is_spread: has_moments }
}

/// The film of 1 + cos(2 pi (x fx + y fy)), with its moments, from samples that are spread by a box.
fn film_of_wave(size: u32, [fx, fy]: [f64; 2], spread: f64) -> (Image, [Image; 2]) {
    let boxes = sinc(spread * fx) * sinc(spread * fy);
    let plane = |of: &dyn Fn(f64) -> f64| {
        Plane::from_fn(size, size, |x, y| {
            let phase = 2.0 * PI * (fx * (f64::from(x) + 0.5) + fy * (f64::from(y) + 0.5));
            [of(phase) as f32; 3]
        })
    };
    let mean = plane(&|phase| 1.0 + boxes * sinc(fx) * sinc(fy) * phase.cos());
    let right = plane(&|phase| -boxes * ramp(fx) * sinc(fy) * phase.sin());
    let down = plane(&|phase| -boxes * sinc(fx) * ramp(fy) * phase.sin());
    (mean, [right, down])
}

/// The largest difference from `1 + amplitude cos` far from the border.
fn error(image: &Image, [fx, fy]: [f64; 2], amplitude: f64) -> f64 {
    let (size, border) = (image.width(), image.width() / 3);
    let mut worst = 0.0f64;
    for (x, y) in (border..size - border).flat_map(|y| (border..size - border).map(move |x| (x, y))) {
        let phase = 2.0 * PI * (fx * (f64::from(x) + 0.5) + fy * (f64::from(y) + 0.5));
        worst = worst.max((f64::from(image.at(x, y)[1]) - 1.0 - amplitude * phase.cos()).abs());
    }
    worst
}

/// Waves of any frequency and direction have the amplitude of the MTF of lens times pixel: within 1 % up to the Nyquist
/// frequency, within 5 % above, and within 7 % above for lenses that need no spread.
#[test]
fn the_transfer_function_is_that_of_lens_and_pixel() {
    for f_number in [0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0] {
        let is_spread = lens(f_number).needs_spread(PITCH);
        assert_eq!(is_spread, f_number >= 2.0);
        let blur = LensBlur::new(&lens(f_number), PITCH, &MeanImage { is_spread, ..kind(true) }).expect("it blurs");
        let (mut below, mut above) = (0.0f64, 0.0f64);
        for step in 1..=28 {
            let f = 0.05 * f64::from(step) + 1e-3;
            for at in [[f, 0.0], [0.0, f], [f, f], [f, 0.3], [0.97 * f, 0.26 * f]] {
                let (radiance, moments) = film_of_wave(150, at, if is_spread { SPREAD } else { 0.0 });
                let image = blur.image(&MeanImage { radiance, moments: Some(moments), is_spread });
                let error = error(&image, at, sinc(at[0]) * sinc(at[1]) * mtf(f_number, at));
                let is_below = at[0].max(at[1]) <= 0.502;
                let worst = if is_below { &mut below } else { &mut above };
                *worst = worst.max(error);
            }
        }
        println!("f/{f_number}: below {below:.4}, above {above:.4}");
        let most = if is_spread { 0.05 } else { 0.07 };
        assert!(below < 0.01 && above < most, "f/{f_number}: {below:.4} below the Nyquist frequency, {above:.4} above");
    }
}

/// A film of another renderer has no moments. Up to 0.8 of the Nyquist frequency its image is right within 6 %.
#[test]
fn a_film_without_moments_is_right_below_the_nyquist_frequency() {
    for f_number in [2.8, 5.6, 8.0, 16.0] {
        let blur = LensBlur::new(&lens(f_number), PITCH, &kind(false)).expect("it blurs");
        for f in [0.02, 0.1, 0.2, 0.3, 0.4] {
            for at in [[f, 0.0], [f, 0.5 * f], [f, f]] {
                let (mean, _) = film_of_wave(150, at, 0.0);
                let error = error(&blur.image(&mean.clone().into()), at, sinc(at[0]) * sinc(at[1]) * mtf(f_number, at));
                assert!(error < 0.06, "f/{f_number}, {at:?}: {error:.4}");
            }
        }
    }
}

/// A film of arbitrary radiances.
fn random_film(width: u32, height: u32) -> (Image, [Image; 2]) {
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1u32 << 24) as f32
    };
    let mean = Plane::from_fn(width, height, |_, _| [(); 3].map(|()| random().powi(20) * 1e4));
    let moments = [(); 2].map(|()| mean.map(|p| p.map(|v| v * (random() - 0.5))));
    (mean, moments)
}

fn sum(image: &Image, channel: usize) -> f64 {
    image.data().iter().map(|p| f64::from(p[channel])).sum()
}

#[test]
fn the_light_of_the_film_stays() {
    for (width, height) in [(64, 48), (7, 5), (1, 1), (131, 1)] {
        let (mean, moments) = random_film(width, height);
        for f_number in [2.8, 8.0, 32.0] {
            let optics = lens(f_number).with_glare(0.03).expect("in range");
            for moments in [None, Some(&moments)] {
                let blur = LensBlur::new(&optics, PITCH, &kind(moments.is_some())).expect("it blurs");
                let image =
                    blur.image(&MeanImage { radiance: mean.clone(), moments: moments.cloned(), is_spread: true });
                for channel in 0..3 {
                    let ratio = sum(&image, channel) / sum(&mean, channel);
                    assert!((ratio - 1.0).abs() < 1e-6, "{width} x {height}, f/{f_number}: {ratio}");
                }
            }
        }
    }
}

/// The image is never negative, although no light is cut off. Pixels that are no radiances stay.
#[test]
fn a_bright_point_has_no_dark_ring() {
    for f_number in [1.4, 4.0, 8.0, 16.0] {
        let blur = LensBlur::new(&lens(f_number), PITCH, &kind(true)).expect("it blurs");
        for place in [[0.0, 0.0], [0.5, 0.0], [-0.5, 0.5]] {
            let at = |x: u32, y: u32, v: f64| if (x, y) == (20, 20) { [1e6 * v as f32; 3] } else { [0.0; 3] };
            let mean = Plane::from_fn(41, 41, |x, y| at(x, y, 1.0));
            let moments = place.map(|p| Plane::from_fn(41, 41, |x, y| at(x, y, p)));
            let image =
                blur.image(&MeanImage { radiance: mean.clone(), moments: Some(moments.clone()), is_spread: true });
            let around = image.data().iter().filter(|p| p[0] < 0.0).count();
            // Without negative weights only the rounding of the transform is cut off at zero.
            assert!(around == 0 && (sum(&image, 0) / 1e6 - 1.0).abs() < 1e-6, "f/{f_number} {place:?}");
        }
        let odd = [f32::NAN, f32::INFINITY, -1.0];
        let mean = Plane::from_fn(9, 9, |x, y| if y == 4 && x < 3 { [odd[x as usize]; 3] } else { [1.0; 3] });
        let image = blur.image(&mean.clone().into());
        assert!(image.at(0, 4)[0].is_nan() && image.at(1, 4)[0] == f32::INFINITY && image.at(2, 4)[0] == -1.0);
        assert!(image.data().iter().enumerate().all(|(i, p)| (36..39).contains(&i) || (0.0..=1.0001).contains(&p[0])));
    }
}

/// Veiling glare: the middle of a black disc in a white field gets the share of the glare (ISO 9358, integral method).
#[test]
fn glare_is_the_light_in_a_black_spot() {
    let optics = lens(4.0).with_psf(Psf::None).with_glare(0.02).expect("in range");
    let blur = LensBlur::new(&optics, PITCH, &kind(false)).expect("it has glare");
    let is_black = |x: u32, y: u32| (f64::from(x) - 99.5).hypot(f64::from(y) - 99.5) < 4.0;
    let mean = Plane::from_fn(200, 200, |x, y| if is_black(x, y) { [0.0; 3] } else { [1.0; 3] });
    let spot = f64::from(blur.image(&mean.clone().into()).at(99, 99)[0]);
    assert!((0.018..0.02).contains(&spot), "{spot}");
}

/// Independent noise of samples at random places has the claimed variance behind the lens, per pixel and in blocks.
#[test]
fn the_variance_is_that_of_many_films() {
    let (size, films, samples) = (24, 4000, 4);
    let blur = LensBlur::new(&lens(8.0), PITCH, &kind(true)).expect("it blurs");
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u32 << 24) as f32
    };
    // The noise of the left half is three times that of the right one. Its mean is zero, so that its place does not count.
    let scale = |x: u32| if x < size / 2 { 3.0 } else { 1.0 };
    let mut sums = vec![[0.0f64; 2]; (size * size) as usize];
    let mut of_blocks = [0.0f64; 2];
    for _ in 0..films {
        let mut film = Plane::new(size, size, [[0.0f32; 3]; 3]);
        for y in 0..size {
            for x in 0..size {
                let pixel = &mut film.data_mut()[(y * size + x) as usize];
                for _ in 0..samples {
                    let [noise, u, v] = [random(), random(), random()].map(|u| u - 0.5);
                    let value = scale(x) * noise / samples as f32;
                    for (sum, factor) in pixel.iter_mut().zip([1.0, u, v]) {
                        *sum = sum.map(|s| s + value * factor);
                    }
                }
            }
        }
        // Above zero, as radiance is.
        let of = |k: usize, base: f32| film.map(|p| p[k].map(|v| v + base));
        let image =
            blur.image(&MeanImage { radiance: of(0, 10.0), moments: Some([of(1, 0.0), of(2, 0.0)]), is_spread: true });
        for (sum, pixel) in sums.iter_mut().zip(image.data()) {
            let v = f64::from(pixel[0]) - 10.0;
            *sum = [sum[0] + v, sum[1] + v * v];
        }
        let block =
            |x: u32, y: u32| (0..64).map(|i| f64::from(image.at(x + i % 8, y + i / 8)[0]) - 10.0).sum::<f64>() / 64.0;
        for (sum, x) in of_blocks.iter_mut().zip([0, 16]) {
            *sum += block(x, 8).powi(2);
        }
    }
    let of_pixel = |x: u32| scale(x).powi(2) / 12.0 / samples as f32;
    let variance = Plane::from_fn(size, size, |x, _| of_pixel(x));
    let claimed = blur.variance(&variance, &variance, [0.2, 0.5, 0.3]);
    for (x, y) in [(0, 12), (1, 12), (6, 12), (11, 12), (12, 12), (18, 12), (23, 12)] {
        // The mean over pixels of a column with the same expected variance.
        let rows = 6..18;
        let measured: f64 =
            rows.clone().map(|y| sums[(y * size + x) as usize][1] / f64::from(films)).sum::<f64>() / 12.0;
        let ratio = measured / f64::from(*claimed.at(x, 12));
        // Twelve correlated estimates of 4000 films: a standard error below 1 %.
        assert!((ratio - 1.0).abs() < 0.05, "({x}, {y}): {ratio}");
    }
    let blocks = blur.variance_of_blocks(&variance, &variance, [1.0, 0.0, 0.0]);
    for (sum, x) in of_blocks.iter().zip([0, 16]) {
        let ratio = sum / f64::from(films) / f64::from(*blocks.at(x, 8));
        // 4000 normal numbers: a standard error of 2.2 %.
        assert!((ratio - 1.0).abs() < 0.13, "block at {x}: {ratio}");
    }
    // Blocks gain little from a lens that a pixel gains most from.
    let (gain, kept) = (of_pixel(20) / claimed.at(18, 12), blocks.at(16, 8) * 64.0 / of_pixel(20));
    assert!((4.0..7.0).contains(&gain) && (0.6..1.0).contains(&kept), "{gain} {kept}");
}

/// Noise behind the lens together with what the camera restores has the variance of the noise in front of the lens, in every
/// pixel, and a flat spectrum.
#[test]
fn restored_noise_is_white() {
    let (size, films, samples) = (32u32, 2000, 3);
    let blur = LensBlur::new(&lens(8.0), PITCH, &kind(true)).expect("it blurs");
    let mut state = 3u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u32 << 24) as f32
    };
    let variance = Plane::new(size, size, 1.0 / 12.0 / samples as f32);
    // Twelve uniform numbers give a normal one closely enough.
    let normals: Vec<Vec<f64>> = (0..films)
        .map(|_| (0..size * size).map(|_| (0..12).map(|_| f64::from(random())).sum::<f64>() - 6.0).collect())
        .collect();
    // The power at a few frequencies, from the first to the last below the Nyquist frequency, and the variance.
    let frequencies = [[1, 0], [0, 3], [4, 4], [8, 0], [8, 8], [15, 0], [15, 15], [0, 12]];
    let (mut power, mut total) = ([0.0f64; 8], 0.0f64);
    for normals in &normals {
        let mut film = Plane::new(size, size, [[0.0f32; 3]; 3]);
        for pixel in film.data_mut() {
            for _ in 0..samples {
                let [noise, u, v] = [random(), random(), random()].map(|u| u - 0.5);
                for (sum, factor) in pixel.iter_mut().zip([1.0, u, v]) {
                    *sum = sum.map(|s| s + noise * factor / samples as f32);
                }
            }
        }
        let of = |k: usize, base: f32| film.map(|p| p[k].map(|v| v + base));
        let image =
            blur.image(&MeanImage { radiance: of(0, 10.0), moments: Some([of(1, 0.0), of(2, 0.0)]), is_spread: true });
        let restored = blur.restored(&variance, [1.0, 0.0, 0.0], |pixel| normals[pixel]);
        let pixels = image.data().iter().zip(restored.data());
        let noise: Vec<f64> = pixels.map(|(p, r)| f64::from(p[0]) - 10.0 + f64::from(*r)).collect();
        total += noise.iter().map(|v| v * v).sum::<f64>() / f64::from(size * size);
        for (power, [fx, fy]) in power.iter_mut().zip(frequencies) {
            // Mirrored noise has a spectrum of cosines.
            let wave = |f: u32, at: usize| (PI * f64::from(f) * (at as f64 + 0.5) / f64::from(size) * 2.0).cos();
            let n = size as usize;
            let sum: f64 = noise.iter().enumerate().map(|(i, v)| v * wave(fx, i % n) * wave(fy, i / n)).sum();
            *power += sum * sum * if fx == 0 || fy == 0 { 2.0 } else { 4.0 } / f64::from(size * size);
        }
    }
    let expected = f64::from(*variance.at(0, 0)) * f64::from(films);
    // 2000 squares of normal numbers: a standard error of 3.2 %. The variance: that of a million of them.
    for (power, at) in power.iter().zip(frequencies) {
        assert!((power / expected - 1.0).abs() < 0.17, "{at:?}: {}", power / expected);
    }
    assert!((total / expected - 1.0).abs() < 0.01, "{}", total / expected);
    let claimed = blur.restored_variance(&variance, [1.0, 0.0, 0.0]);
    assert!(claimed.data().iter().all(|v| (v / variance.at(0, 0) - 1.0).abs() < 0.01), "{:?}", claimed.at(16, 16));
}
