//! Tests of the fixed pattern of a device, with its parts of rows, columns and pixels, and of row noise, hot and dead
//! pixels. Tests of the independence of pixels, rows, columns, frames and colours.
//!
//! Seeds are fixed. The stated rates are the probabilities that a correct implementation fails with a random seed.

use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::{DigitalNumber, Electrons, Seconds};
use dunkelfeld_sensor::{
    BayerPattern, Defects, Device, Exposure, FixedPattern, FrameKey, PixelMap, PixelMaps, Readout, SensorError,
    SensorModel, SensorSpec,
};
use dunkelfeld_testkit::{sidak, z_test};

/// False-alarm rate of each test function as a whole.
const RATE: f64 = 1e-10;

/// More bits and a deeper well, so that no value is clipped.
fn spec() -> SensorSpec {
    SensorSpec {
        full_well: Electrons(30_000.0),
        system_gain: 0.5,
        offset: DigitalNumber(100.0),
        bit_depth: 16,
        ..crate::support::spec()
    }
}

fn faulty() -> FixedPattern {
    FixedPattern {
        dsnu: Electrons(2.5),
        dsnu_row: Electrons(1.2),
        dsnu_column: Electrons(0.9),
        prnu: 0.01,
        prnu_row: 0.005,
        prnu_column: 0.003,
        ..FixedPattern::default()
    }
}

fn device(spec: SensorSpec, seed: u64, size: (u32, u32)) -> Device {
    Device::new(SensorModel::new(spec).expect("valid"), seed, size.0, size.1).expect("a size")
}

/// 20 ms: two dark electrons per pixel.
fn exposure() -> Exposure {
    Exposure::new(Seconds(0.02)).expect("valid")
}

fn frame(device: &Device, electrons: &Plane<f32>, frame: u32) -> Vec<f64> {
    let values = device.expose(electrons, exposure(), FrameKey { seed: 11, frame }).expect("sizes agree");
    values.into_vec().into_iter().map(f64::from).collect()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

fn variance(values: &[f64]) -> f64 {
    let m = mean(values.iter().copied());
    mean(values.iter().map(|v| (v - m).powi(2)))
}

/// Variances of rows, columns and pixels: the split of EMVA 1288 release 4.0, for M rows of N columns, of an image
/// without temporal noise.
fn split(image: &[f64], columns: usize) -> [f64; 3] {
    let rows = image.len() / columns;
    let (m, n) = (rows as f64, columns as f64);
    let of_row: Vec<f64> = image.chunks(columns).map(|row| mean(row.iter().copied())).collect();
    let of_column: Vec<f64> = (0..columns).map(|x| mean(image.iter().skip(x).step_by(columns).copied())).collect();
    let (total, rav, cav) = (variance(image), variance(&of_row), variance(&of_column));
    let d = m * n - m - n;
    let column = (m * n - m) / d * cav - n / d * (total - rav);
    let row = (m * n - n) / d * rav - m / d * (total - cav);
    [row, column, m * n / d * (total - cav - rav)]
}

/// Mean over twenty devices, since one has few rows. A variance from n normal numbers has a relative standard error of
/// sqrt(2 / (n - 1)).
#[test]
fn the_parts_of_the_pattern_are_those_that_were_set() {
    const SIZE: (u32, u32) = (300, 400);
    const DEVICES: u64 = 20;
    let pattern = faulty();
    let mut sums = [[0.0; 3]; 2];
    for seed in 0..DEVICES {
        let device = device(SensorSpec { fixed_pattern: pattern.clone(), ..spec() }, seed, SIZE);
        let at = |f: &dyn Fn(dunkelfeld_sensor::PixelPattern) -> f32| -> Vec<f64> {
            let places = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
            places.map(|(x, y)| f64::from(f(device.pixel(x, y).expect("inside")))).collect()
        };
        for (sums, image) in sums.iter_mut().zip([at(&|p| p.dark), at(&|p| p.response)]) {
            for (sum, part) in sums.iter_mut().zip(split(&image, SIZE.0 as usize)) {
                *sum += part / DEVICES as f64;
            }
        }
    }
    let set = [[1.2, 0.9, 2.0], [0.005, 0.003, 66e-6f64.sqrt()]];
    assert!((pattern.dsnu_pixel().0 - set[0][2]).abs() < 1e-12 && (pattern.prnu_pixel() - set[1][2]).abs() < 1e-12);
    let counts = [f64::from(SIZE.1), f64::from(SIZE.0), f64::from(SIZE.0 * SIZE.1)];
    for ((got, set), what) in sums.into_iter().zip(set).zip(["DSNU", "PRNU"]) {
        // The mean over a row contains a small part of the variance of its pixels.
        let leaks = [set[2].powi(2) / counts[1], set[2].powi(2) / counts[0], 0.0];
        for (i, part) in ["rows", "columns", "pixels"].into_iter().enumerate() {
            let expected = set[i].powi(2);
            let error = (expected + leaks[i]) * (2.0 / (counts[i] - 1.0) / DEVICES as f64).sqrt();
            z_test(got[i], error, expected).assert(sidak(RATE, 6), &format!("{what} of {part}, as a variance"));
        }
    }
    let flat = device(spec(), 1, (4, 4));
    assert_eq!(flat.pixel(3, 3).map(|p| (p.dark, p.response)), Some((0.0, 1.0)));
    assert_eq!(flat.pixel(4, 0), None);
}

/// Rows of a frame share a part of the dark noise. Its total stays that of the data sheet (equation 14).
#[test]
fn rows_read_together_within_the_dark_noise() {
    const SIZE: (u32, u32) = (64, 4000);
    let noisy = SensorSpec { dark_noise: Electrons(6.0), row_noise: Electrons(3.0), ..spec() };
    let device = device(noisy, 3, SIZE);
    let flat = Plane::new(SIZE.0, SIZE.1, 50.0);
    let rows = |k| -> (Vec<f64>, f64) {
        let values = frame(&device, &flat, k);
        let within = mean(values.chunks(SIZE.0 as usize).map(variance)) * 64.0 / 63.0;
        (values.chunks(SIZE.0 as usize).map(|row| mean(row.iter().copied())).collect(), within)
    };
    let ((a, within), (b, _)) = (rows(0), rows(1));
    // In DN^2: pixels have shot noise, dark current, and the dark noise without the part of rows. Means of rows have
    // this variance over 64, and the row noise.
    let pixels = 0.25 * (50.0 + 2.0 + 36.0 - 9.0) + 1.0 / 12.0;
    let shared = 0.25 * 9.0;
    let count = f64::from(SIZE.1);
    let expected = shared + pixels / 64.0;
    let rate = sidak(RATE, 5);
    z_test(within, pixels * (2.0 / (63.0 * count)).sqrt() * 1.05, pixels).assert(rate, "variance within rows");
    z_test(variance(&a), expected * (2.0 / count).sqrt(), expected).assert(rate, "variance of the means of rows");
    let total = 0.25 * device.model().temporal_variance(Electrons(50.0), exposure().time());
    assert!((total - shared - pixels).abs() < 1e-12, "the whole is that of the standard: {total}");
    // Rows and frames are independent.
    let error = expected / count.sqrt();
    let m = [mean(a.iter().copied()), mean(b.iter().copied())];
    let lower = mean(a.windows(2).map(|w| (w[0] - m[0]) * (w[1] - m[0])));
    z_test(lower, error, 0.0).assert(rate, "covariance of a row and the next");
    let frames = mean(a.iter().zip(&b).map(|(x, y)| (x - m[0]) * (y - m[1])));
    z_test(frames, error, 0.0).assert(rate, "covariance of frames");
    z_test(m[0], (expected / count).sqrt(), 0.5 * 52.0 + 100.0).assert(rate, "mean");
}

/// Of a million pixels 700 and 300 are expected, as binomial counts.
#[test]
fn hot_and_dead_pixels_have_the_given_share_and_response() {
    const SIZE: (u32, u32) = (1000, 1000);
    let defects = Defects { hot: 700e-6, hot_factor: 50.0, dead: 300e-6 };
    let device = |seed| device(SensorSpec { defects, ..spec() }, seed, SIZE);
    let dead = |device: &Device| -> Vec<(u32, u32)> {
        let places = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
        places.filter(|&(x, y)| device.pixel(x, y).is_some_and(|p| p.response == 0.0)).collect()
    };
    let one = device(1);
    let (hot, dead_ones): (Vec<_>, _) = (one.hot_pixels().collect(), dead(&one));
    let rate = sidak(RATE, 5);
    for (count, share, what) in [(hot.len(), defects.hot, "hot"), (dead_ones.len(), defects.dead, "dead")] {
        let expected = 1e6 * share;
        z_test(count as f64, (expected * (1.0 - share)).sqrt(), expected).assert(rate, &format!("{what} pixels"));
    }
    assert!(!dead_ones.iter().any(|p| hot.contains(p)), "a pixel has one fault");
    assert_eq!(device(1).hot_pixels().collect::<Vec<_>>(), hot, "the seed decides");
    assert_ne!(device(2).hot_pixels().collect::<Vec<_>>(), hot);

    // Hot pixels have 50 times two dark electrons, dead ones two dark electrons and no light, the others both light and
    // dark electrons.
    let flat = Plane::new(SIZE.0, SIZE.1, 400.0);
    let values = frame(&one, &flat, 0);
    let at = |&(x, y): &(u32, u32)| values[(y * SIZE.0 + x) as usize];
    let others = [(0u32, 0u32), (999, 999)].iter().filter(|p| !hot.contains(p) && !dead_ones.contains(p)).map(at);
    assert!(others.into_iter().all(|y| (y - 301.0).abs() < 80.0));
    for (places, electrons, what) in [(&hot, 400.0 + 100.0, "hot"), (&dead_ones, 2.0, "dead")] {
        let n = places.len() as f64;
        let error = ((0.25 * (electrons + 16.0) + 1.0 / 12.0) / n).sqrt();
        let expected = 0.5 * electrons + 100.0;
        z_test(mean(places.iter().map(at)), error, expected).assert(rate, &format!("mean of {what} pixels"));
    }
    let of_all = mean(values.iter().copied());
    let expected = 100.0 + 0.5 * (402.0 + (hot.len() as f64 * 98.0 - dead_ones.len() as f64 * 400.0) / 1e6);
    let error = ((0.25 * 418.0 + 1.0 / 12.0) / 1e6f64).sqrt();
    z_test(of_all, error, expected).assert(rate, "mean of all pixels");
}

/// Two million pixels with a filter, each colour at its own level: no correlation reaches 0.01. Correlations of 500 000
/// pairs have a standard deviation of 0.0014, so that the bound is seven of them. There are 11 bounds at 2e-12 each.
#[test]
fn neighbours_frames_and_colours_are_independent() {
    const SIZE: (u32, u32) = (2048, 1024);
    let device = device(spec(), 9, SIZE);
    let levels = [900.0, 1700.0, 500.0];
    let mosaic = Plane::from_fn(SIZE.0, SIZE.1, |x, y| levels[BayerPattern::Rggb.color_at(x, y) as usize]);
    let (a, b) = (frame(&device, &mosaic, 0), frame(&device, &mosaic, 1));
    let width = SIZE.0 as usize;
    // One pixel of each square of four.
    let phase = |values: &[f64], dx: usize, dy: usize| -> Vec<f64> {
        let rows = values.chunks(width).skip(dy).step_by(2);
        rows.flat_map(|row| row.iter().skip(dx).step_by(2).copied().collect::<Vec<_>>()).collect()
    };
    let [red, green, low_green, blue] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| phase(&a, dx, dy));
    let shifted = |v: &[f64], by: usize| -> Vec<f64> { v.iter().cycle().skip(by).take(v.len()).copied().collect() };
    let lines = |v: &[f64]| -> Vec<f64> { v.chunks(width / 2).map(|row| mean(row.iter().copied())).collect() };
    let cases = [
        ("red and green", correlation(&red, &green)),
        ("red and lower green", correlation(&red, &low_green)),
        ("red and blue", correlation(&red, &blue)),
        ("green and blue", correlation(&green, &blue)),
        ("both greens", correlation(&green, &low_green)),
        ("red and the next red", correlation(&red, &shifted(&red, 1))),
        ("red and the red two rows below", correlation(&red, &shifted(&red, width / 2))),
        ("red of two frames", correlation(&red, &phase(&b, 0, 0))),
        ("blue of two frames", correlation(&blue, &phase(&b, 1, 1))),
    ];
    for (what, r) in cases {
        assert!(r.abs() < 0.01, "{what}: correlation {r:.4}");
    }
    // Without row noise the means of rows scatter as those of their pixels do.
    let expected = (0.25 * (900.0 + 18.0) + 1.0 / 12.0) / (width / 2) as f64;
    let rows = lines(&red);
    let error = expected * (2.0 / rows.len() as f64).sqrt();
    z_test(variance(&rows), error, expected).assert(sidak(RATE, 1), "variance of the means of rows");
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (mean(a.iter().copied()), mean(b.iter().copied()));
    mean(a.iter().zip(b).map(|(x, y)| (x - ma) * (y - mb))) / (variance(a) * variance(b)).sqrt()
}

/// With all effects at once, plain and matched: rows that are exposed alone, in any order, equal those of the frame.
#[test]
fn rows_in_any_order_are_those_of_the_frame() {
    const SIZE: (u32, u32) = (97, 60);
    let defects = Defects { hot: 0.02, hot_factor: 30.0, dead: 0.01 };
    let all = SensorSpec { fixed_pattern: faulty(), defects, row_noise: Electrons(2.0), ..spec() };
    let device = device(all, 4, SIZE);
    let electrons = Plane::from_fn(SIZE.0, SIZE.1, |x, y| (x * y) as f32 * 0.3);
    let known = electrons.map(|e| 0.4 * e);
    let key = FrameKey { seed: 1, frame: 2 };
    assert!(device.hot_pixels().count() > 50);
    for matched in [false, true] {
        let rows = |rows: std::ops::Range<u32>| {
            let mut out = vec![0; (rows.len() as u32 * SIZE.0) as usize];
            if matched {
                device.expose_rows_matched(&electrons, &known, exposure(), key, rows, &mut out)
            } else {
                device.expose_rows(&electrons, exposure(), key, rows, &mut out)
            }
            .expect("sizes agree");
            out
        };
        let whole = rows(0..SIZE.1);
        for part in [59..60, 0..1, 31..47, 7..31] {
            let place = (part.start * SIZE.0) as usize..(part.end * SIZE.0) as usize;
            assert_eq!(rows(part.clone()), whole[place], "rows {part:?}, matched: {matched}");
        }
    }
}

/// All rows of a line scan have the pattern of the same pixels: DSNU and PRNU appear as columns, and hot pixels as whole
/// columns. Over n stages the variance of the differences is divided by n. The sum of c squared normal numbers has the
/// variance 2 c, so that the standard error of the ratio is sqrt(2 / c).
#[test]
fn a_line_scan_has_the_pattern_of_its_columns() {
    const WIDTH: u32 = 20_000;
    let pixels_only = FixedPattern { dsnu: Electrons(2.5), prnu: 0.01, ..FixedPattern::default() };
    let defects = Defects { hot: 0.01, hot_factor: 30.0, dead: 0.0 };
    let model = SensorModel::new(SensorSpec { fixed_pattern: pixels_only, defects, ..spec() }).expect("valid");
    for stages in [1, 4] {
        let readout = Readout { line_scan_stages: stages, ..Readout::default() };
        let device = Device::with_readout(model.clone(), 5, [WIDTH, 3], readout).expect("no maps");
        let row = |y| (0..WIDTH).map(move |x| (x, y));
        let pattern = |y| row(y).map(|(x, y)| device.pixel(x, y).expect("inside")).collect::<Vec<_>>();
        assert!(pattern(0) == pattern(1) && pattern(0) == pattern(2));
        let dark = variance(&pattern(0).iter().map(|p| f64::from(p.dark)).collect::<Vec<_>>());
        let response = variance(&pattern(0).iter().map(|p| f64::from(p.response)).collect::<Vec<_>>());
        let n = f64::from(stages);
        let error = (2.0 / f64::from(WIDTH)).sqrt();
        z_test(dark / (2.5 * 2.5 / n), error, 1.0).assert(sidak(RATE, 6), &format!("DSNU of {stages} stages"));
        z_test(response / (0.01 * 0.01 / n), error, 1.0).assert(sidak(RATE, 6), &format!("PRNU of {stages} stages"));
        let hot: Vec<(u32, u32)> = device.hot_pixels().collect();
        let (first, columns) = (hot.iter().filter(|p| p.1 == 0), hot.len() / 3);
        assert!(first.clone().count() == columns && first.clone().all(|&(x, _)| hot.contains(&(x, 2))));
        let share = 1.0 - 0.99f64.powi(stages as i32);
        let expected = share * f64::from(WIDTH);
        z_test(columns as f64, (expected * (1.0 - share)).sqrt(), expected).assert(sidak(RATE, 6), "hot columns");
    }
}

fn map(width: u32, height: u32, at: impl FnMut(u32, u32) -> f32) -> PixelMap {
    PixelMap::new(Plane::from_fn(width, height, at)).expect("finite")
}

/// Maps replace the drawn pattern, whatever the seed. What has no map is drawn as without maps.
#[test]
fn a_device_has_the_pixels_of_its_maps() {
    const SIZE: (u32, u32) = (20, 10);
    let with = |maps: PixelMaps| SensorSpec { fixed_pattern: FixedPattern { maps, ..faulty() }, ..spec() };
    let dark = |x: u32, y: u32| x as f32 - 3.0 * y as f32;
    let flat = |x: u32, _: u32| 1.0 + 0.01 * x as f32;
    let dsnu = Some(map(SIZE.0, SIZE.1, dark));
    let flat_field = Some(map(SIZE.0, SIZE.1, flat));
    let drawn = device(with(PixelMaps::default()), 7, SIZE);
    let partly = device(with(PixelMaps { dsnu: dsnu.clone(), flat_field: flat_field.clone(), prnu: None }), 7, SIZE);
    let prnu = Some(map(SIZE.0, SIZE.1, |x, y| 1.0 + 0.1 * ((x + y) % 2) as f32));
    let all = PixelMaps { dsnu, prnu, flat_field };
    let wholly = device(with(all.clone()), 99, SIZE);
    for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
        let at = |device: &Device| device.pixel(x, y).expect("inside");
        assert_eq!(at(&partly).dark, dark(x, y));
        assert_eq!(at(&partly).response, at(&drawn).response * flat(x, y));
        assert_eq!(at(&wholly).dark, dark(x, y));
        assert_eq!(at(&wholly).response, (1.0 + 0.1 * ((x + y) % 2) as f32) * flat(x, y));
    }
    // A dead pixel stays dead, and a model with maps is restored to the last bit.
    let spec = SensorSpec { defects: Defects { dead: 0.1, ..Defects::default() }, ..with(all) };
    let dead = device(spec.clone(), 1, SIZE);
    let pixels = (0..SIZE.0 * SIZE.1).map(|i| dead.pixel(i % SIZE.0, i / SIZE.0).expect("inside").response);
    assert!((1..60).contains(&pixels.filter(|r| *r == 0.0).count()));
    let model = SensorModel::new(spec).expect("valid");
    let text = serde_json::to_string(&model).expect("plain data");
    assert_eq!(serde_json::from_str::<SensorModel>(&text).expect("the text that was written"), model);
}

#[test]
fn maps_that_do_not_fit_are_refused() {
    let with =
        |maps: PixelMaps| SensorModel::new(SensorSpec { fixed_pattern: FixedPattern { maps, ..faulty() }, ..spec() });
    let dsnu = Some(map(20, 10, |_, _| -1.0));
    let model = with(PixelMaps { dsnu: dsnu.clone(), ..PixelMaps::default() }).expect("valid");
    assert!(matches!(Device::new(model.clone(), 1, 20, 11), Err(SensorError::Size(20, 11, 20, 10))));
    assert!(model.binned(2).is_err() && model.without_maps().binned(2).is_ok());
    let flat_field = Some(map(20, 11, |_, _| 1.0));
    assert!(with(PixelMaps { dsnu: dsnu.clone(), flat_field, ..PixelMaps::default() }).is_err());
    assert!(with(PixelMaps { prnu: dsnu, ..PixelMaps::default() }).is_err());
    assert!(PixelMap::new(Plane::new(2, 2, f32::NAN)).is_err());
}
