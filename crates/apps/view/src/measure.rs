//! Measurements of the frames that are shown: pixels, regions, lines, photon transfer.

use crate::developed::Developed;
use crate::protocol::{
    Channel, Fault, HeavyProbe, Histogram, Line, PhotonTransfer, Probe, Region, Regions, TransferLine, TransferPoint,
};
use dunkelfeld::Exposer;
use dunkelfeld::film::Plane;

/// The most values of a line profile.
const MAX_LINE: usize = 4096;
/// The most bins of a histogram.
const MAX_BINS: u32 = 256;
/// Points of a photon transfer, and the fewest pixels of one.
const POINTS: usize = 24;
const LEAST_PIXELS: usize = 64;
/// A pixel is part of it if its expected grey value is so many standard deviations above zero. The values that are cut off
/// then change the variance by less than 0.1 %.
const CUT: f64 = 4.0;

fn no_sensor() -> Fault {
    Fault::new("there is no sensor, so there are no grey values", "choose a sensor")
}

/// The values of a pixel. Those of the noise are of the unbiased film of the same picture behind the same camera.
pub(crate) fn probe(developed: &Developed, unbiased: &Developed, frame: u32, [x, y]: [u32; 2]) -> Result<Probe, Fault> {
    let snapshot = &developed.snapshot;
    let [width, height] = snapshot.size();
    if x >= width || y >= height {
        let problem = format!("the pixel {x}, {y} is outside {width} x {height}");
        return Err(Fault::new(problem, "choose a pixel of the image"));
    }
    let film = snapshot.film();
    let sums = film.map(|film| film.sums.pixel(x, y)).unwrap_or_default();
    let values = developed.values(frame)?;
    let electrons = developed.exposer.as_ref().map(|exposer| *exposer.electrons().at(x, y));
    let of_film = unbiased.exposer.as_ref();
    let camera_sigma = of_film.map(|exposer| Developed::camera_sigma(exposer, *exposer.electrons().at(x, y)));
    let ratio = unbiased.certified().map(|c| f64::from(*c.ratios.at(x, y)).sqrt()).filter(|ratio| ratio.is_finite());
    let ids = film.and_then(|film| *film.ids.at(x, y));
    let [object, material] = match (film.zip(ids), snapshot.exr()) {
        (Some((film, ids)), _) => [
            film.object_names.get(ids.object() as usize).cloned(),
            film.material_names.get(ids.material() as usize).cloned(),
        ],
        (None, Some(image)) => image.surface_at(x, y),
        (None, None) => [None, None],
    };
    let of_exr = |count: u32| (snapshot.samples > 0).then_some(count);
    let heaviest = unbiased.heaviest(x, y);
    let depth = sums.mean_depth();
    Ok(Probe {
        x,
        y,
        channel: developed.exposer.as_ref().and_then(|exposer| channel_at(exposer, x, y)),
        value: values.map(|values| *values.at(x, y)),
        electrons,
        radiance: *developed.radiance().at(x, y),
        camera_sigma,
        render_sigma: ratio.zip(camera_sigma).map(|(ratio, sigma)| ratio * sigma),
        ratio,
        samples: if film.is_some() { Some(sums.count()) } else { of_exr(*snapshot.counts.at(x, y)) },
        object,
        material,
        depth: (depth > 0.0).then_some(depth),
        heaviest: heaviest.map(|heaviest| HeavyProbe { index: heaviest.index, share: heaviest.share }),
    })
}

/// Mean grey value without light \[DN\]: the offset, and the dark signal of the exposure (EMVA 1288: `mu_y.dark`).
fn dark_value(exposer: &Exposer) -> f64 {
    let model = exposer.model();
    let dark = model.dark_electrons(exposer.exposure().time()).0;
    model.spec().offset.0 + model.spec().system_gain * dark
}

/// The colour of a pixel. `None` without a filter.
fn channel_at(exposer: &Exposer, x: u32, y: u32) -> Option<Channel> {
    let filter = exposer.model().spec().quantum_efficiency.filter()?;
    Some(filter.pattern.color_at(x, y).into())
}

/// Refuses the choice of a colour for a sensor without a filter.
fn check_channel(exposer: &Exposer, channel: Option<Channel>) -> Result<(), Fault> {
    match (channel, exposer.model().spec().quantum_efficiency.filter()) {
        (Some(_), None) => Err(Fault::new("the sensor has no colour filter", "choose no colour")),
        _ => Ok(()),
    }
}

/// The grey values of regions, and the contrast of two. Their histograms have common bins.
pub(crate) fn regions(
    developed: &Developed,
    frame: u32,
    regions: &[[u32; 4]],
    channel: Option<Channel>,
) -> Result<Regions, Fault> {
    if regions.is_empty() || regions.len() > 2 {
        return Err(Fault::new(format!("{} regions were given", regions.len()), "give one or two"));
    }
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
    check_channel(exposer, channel)?;
    let values = developed.values(frame)?.ok_or_else(no_sensor)?;
    let inside: Vec<Vec<u16>> =
        regions.iter().map(|region| values_in(exposer, &values, *region, channel)).collect::<Result<_, _>>()?;
    let all = || inside.iter().flatten().copied();
    let (min, max) = (all().min().unwrap_or(0), all().max().unwrap_or(0));
    let found: Vec<Region> = inside.iter().map(|inside| of_region(exposer, inside, [min, max])).collect();
    let (contrast, cnr) = match &found[..] {
        [a, b] => {
            let contrast = a.mean - b.mean;
            // The noise of a pixel at the mean of the second region, the background.
            let background = (b.mean - dark_value(exposer)) / exposer.model().spec().system_gain;
            let sigma = Developed::camera_sigma(exposer, background.max(0.0) as f32);
            (Some(contrast), (sigma > 0.0).then(|| contrast.abs() / sigma))
        }
        _ => (None, None),
    };
    Ok(Regions { regions: found, contrast, cnr })
}

/// The grey values of the pixels of a region and a colour.
fn values_in(
    exposer: &Exposer,
    values: &Plane<u16>,
    [x0, y0, x1, y1]: [u32; 4],
    channel: Option<Channel>,
) -> Result<Vec<u16>, Fault> {
    if x1 > values.width() || y1 > values.height() {
        let problem =
            format!("the region {x0} {y0} {x1} {y1} leaves the image of {} x {}", values.width(), values.height());
        return Err(Fault::new(problem, "draw the region on the image"));
    }
    let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
    let is_meant = |&(x, y): &(u32, u32)| channel.is_none() || channel_at(exposer, x, y) == channel;
    let inside: Vec<u16> = pixels.filter(is_meant).map(|(x, y)| *values.at(x, y)).collect();
    if inside.is_empty() {
        return Err(Fault::new("the region contains no pixel", "draw a larger region on the image"));
    }
    Ok(inside)
}

/// The statistics of grey values, with a histogram from `low` to `high`.
fn of_region(exposer: &Exposer, inside: &[u16], [low, high]: [u16; 2]) -> Region {
    let n = inside.len() as f64;
    let mean = inside.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let squares: f64 = inside.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum();
    let variance = if n > 1.0 { squares / (n - 1.0) } else { 0.0 };
    let (min, max) = inside.iter().fold((u16::MAX, 0), |(least, most), &v| (least.min(v), most.max(v)));
    let span = u32::from(high - low) + 1;
    let bin = span.div_ceil(MAX_BINS);
    let mut counts = vec![0u64; span.div_ceil(bin) as usize];
    inside.iter().for_each(|&v| counts[(u32::from(v - low) / bin) as usize] += 1);
    let full = exposer.model().saturation_value().0.floor() as u16;
    Region {
        pixels: inside.len() as u64,
        mean,
        variance,
        min,
        max,
        snr: (variance > 0.0).then(|| (mean - dark_value(exposer)) / variance.sqrt()),
        saturated: inside.iter().filter(|&&v| v >= full).count() as f64 / n,
        histogram: Histogram { low: low.into(), width: bin, counts },
    }
}

/// The grey values along a line, from pixel to pixel. With a colour, each is that of the nearest pixel of this colour.
pub(crate) fn line(
    developed: &Developed,
    frame: u32,
    [from, to]: [[f64; 2]; 2],
    channel: Option<Channel>,
) -> Result<Line, Fault> {
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
    check_channel(exposer, channel)?;
    let values = developed.values(frame)?.ok_or_else(no_sensor)?;
    let is_inside = |[x, y]: [f64; 2]| {
        (0.0..f64::from(values.width())).contains(&x) && (0.0..f64::from(values.height())).contains(&y)
    };
    if !is_inside(from) || !is_inside(to) {
        return Err(Fault::new("the line leaves the image", "draw the line on the image"));
    }
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let steps = (length.ceil() as usize + 1).clamp(1, MAX_LINE);
    let mut line = Line { values: Vec::new(), expected: Vec::new(), sigma: Vec::new(), length };
    for step in 0..steps {
        let share = if steps > 1 { step as f64 / (steps - 1) as f64 } else { 0.0 };
        let place = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
        let Some([x, y]) = nearest(exposer, place, [values.width(), values.height()], channel) else { continue };
        let electrons = *exposer.electrons().at(x, y);
        line.values.push(*values.at(x, y));
        line.expected.push(Developed::expected(exposer, electrons));
        line.sigma.push(Developed::camera_sigma(exposer, electrons));
    }
    Ok(line)
}

/// The pixel of a colour whose centre is nearest to a place; any pixel without a colour. `None` if there is none beside it.
fn nearest(
    exposer: &Exposer,
    place: [f64; 2],
    [width, height]: [u32; 2],
    channel: Option<Channel>,
) -> Option<[u32; 2]> {
    let [x, y] = place.map(|v| v.round() as u32);
    let (x, y) = (x.min(width - 1), y.min(height - 1));
    if channel.is_none() || channel_at(exposer, x, y) == channel {
        return Some([x, y]);
    }
    let around = |v: u32, size: u32| v.saturating_sub(1)..(v + 2).min(size);
    let distance = |&[x, y]: &[u32; 2]| (f64::from(x) - place[0]).hypot(f64::from(y) - place[1]);
    around(y, height)
        .flat_map(|y| around(x, width).map(move |x| [x, y]))
        .filter(|&[x, y]| channel_at(exposer, x, y) == channel)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The photon transfer of two frames of one device (EMVA 1288): half of the variance of their differences, over pixels
/// with similar expected grey values.
pub(crate) fn photon_transfer(developed: &Developed) -> Result<PhotonTransfer, Fault> {
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
    let model = exposer.model();
    let (a, b) = (exposer.frame(0)?, exposer.frame(1)?);
    let full = model.saturation_value().0;
    let pattern = model.spec().system_gain * model.spec().fixed_pattern.dsnu.0;
    // Saturation cuts the noise off, and so does the grey value zero.
    let is_whole = |e: f32| {
        let expected = Developed::expected(exposer, e);
        let sigma = Developed::camera_sigma(exposer, e).hypot(pattern);
        (expected < 0.9 * full && expected > CUT * sigma).then_some(expected)
    };
    let mut pixels: Vec<(f64, f64, f64)> = (exposer.electrons().data().iter().zip(a.data()).zip(b.data()))
        .filter_map(|((&e, &a), &b)| Some((is_whole(e)?, f64::from(a), f64::from(b))))
        .collect();
    pixels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let size = pixels.len().div_ceil(POINTS).max(LEAST_PIXELS);
    let of_group = |group: &[(f64, f64, f64)]| {
        let n = group.len() as f64;
        let mean = group.iter().map(|p| 0.5 * (p.1 + p.2)).sum::<f64>() / n;
        let offset = group.iter().map(|p| p.1 - p.2).sum::<f64>() / n;
        let squares: f64 = group.iter().map(|p| (p.1 - p.2 - offset).powi(2)).sum();
        TransferPoint { mean, variance: 0.5 * squares / (n - 1.0) }
    };
    let points: Vec<TransferPoint> = pixels.chunks(size).filter(|g| g.len() >= LEAST_PIXELS).map(of_group).collect();
    let n = points.len() as f64;
    let (mean_x, mean_y) =
        (points.iter().map(|p| p.mean).sum::<f64>() / n, points.iter().map(|p| p.variance).sum::<f64>() / n);
    let products: f64 = points.iter().map(|p| (p.mean - mean_x) * (p.variance - mean_y)).sum();
    let squares: f64 = points.iter().map(|p| (p.mean - mean_x).powi(2)).sum();
    if points.len() < 3 || squares <= 0.0 {
        return Err(Fault::new(
            "the image has too few grey values between zero and saturation for a photon transfer",
            "change the exposure, or raise the black level",
        ));
    }
    let slope = products / squares;
    let dark = dark_value(exposer);
    Ok(PhotonTransfer {
        points,
        gain: model.spec().system_gain,
        line: TransferLine { slope, offset: mean_y - slope * mean_x },
        dark,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::developed::{OWN_SENSOR, Sensors};
    use crate::protocol::Camera;
    use crate::snapshot::{Content, PictureScene, Snapshot};
    use crate::store::Store;
    use dunkelfeld::film::{Accumulate, Film, PixelSums, Sample};
    use dunkelfeld::radiometry::{Celsius, DigitalNumber, Electrons, Nanometres, Rgb};
    use dunkelfeld::sensor::{
        BayerPattern, ColorFilter, DarkCurrent, Efficiency, QuantumEfficiency, SensorModel, SensorSpec,
    };
    use dunkelfeld::{ExposeSettings, RenderedFilm, SensorChoice, Session, find_sensor};
    use std::sync::Arc;

    const SIZE: [u32; 2] = [256, 400];

    /// A film whose radiance rises from column to column up to `most`, behind a sensor with so many dark electrons a second,
    /// a gain of 0.3 DN per electron and a dark noise of 5 electrons, for 0.5 s.
    fn developed(most: f32, black_level: f64, rate: f64) -> Arc<Developed> {
        behind(most, black_level, rate, |_| {})
    }

    /// [`developed`] with another sensor.
    fn behind(most: f32, black_level: f64, rate: f64, change: impl FnOnce(&mut SensorSpec)) -> Arc<Developed> {
        let mut spec = find_sensor("imx250").expect("a preset").spec().clone();
        spec.offset = DigitalNumber(black_level);
        spec.system_gain = 0.3;
        spec.dark_noise = Electrons(5.0);
        spec.row_noise = Electrons(0.0);
        spec.dark_current = DarkCurrent { rate, reference: Celsius(25.0), doubling: 8.0 };
        spec.temperature = Celsius(25.0);
        spec.defects = Default::default();
        spec.published = Default::default();
        change(&mut spec);
        let model = SensorModel::new(spec).expect("a sensor");
        let [width, height] = SIZE;
        let mut sums = vec![PixelSums::default(); (width * height) as usize];
        for (i, sums) in sums.iter_mut().enumerate() {
            let radiance = most * (i as u32 % width) as f32 / width as f32;
            sums.add(0, &Sample { radiance: Rgb::splat(radiance), ..Sample::MISS });
        }
        let mut film = Film::new(width, height);
        film.add_rows(0, &sums).expect("memory");
        let optics = ExposeSettings::new(model.clone()).expect("a sensor").optics;
        let sensor = SensorChoice::Emva { model: Box::new(model), optics, exposure: None };
        let mut settings = dunkelfeld::default_settings();
        (settings.width, settings.height, settings.sensor) = (width, height, sensor);
        let scene = PictureScene { sensors: Sensors::new(&settings.sensor), ..PictureScene::default() };
        let film = RenderedFilm::without_ids(film);
        let snapshot = Arc::new(Snapshot::new(1, Content::Film(film), (settings, false), Arc::new(scene), 0.0, None));
        let camera = Camera { exposure: Some(0.5), device: 3, ..Camera::plain(Some(OWN_SENSOR)) };
        Store::default().get(&snapshot, &camera, &Session::new(1).expect("a thread")).expect("a sensor")
    }

    /// The signal of a camera without light is zero, whatever its dark signal: 200 electrons, 60 DN above the black level.
    #[test]
    fn the_signal_leaves_the_dark_signal_out() {
        let dark = developed(0.0, 40.0, 400.0);
        let region = &regions(&dark, 0, &[[0, 0, SIZE[0], SIZE[1]]], None).expect("a region").regions[0];
        // sqrt(25 + 200) e times 0.3 is 4.5 DN, and the fixed pattern is less. The mean of 102400 pixels has a standard
        // deviation of 0.003 of it.
        assert!((region.mean - 100.0).abs() < 0.3 && region.variance > 18.0, "{region:?}");
        assert!(region.snr.expect("noise").abs() < 0.06, "{region:?}");
        let exposer = dark.exposer.as_ref().expect("a sensor");
        assert!((dark_value(exposer) - 100.0).abs() < 1e-9);
    }

    /// Behind a colour filter, a colour is measured at its own pixels: each has its own expected value, and the mixture of all
    /// has another variance.
    #[test]
    fn colours_are_measured_at_their_pixels() {
        let curve = |efficiency| {
            let points = [300.0, 1000.0].map(|wavelength| (Nanometres(wavelength), efficiency));
            QuantumEfficiency::new(points.to_vec()).expect("a curve")
        };
        let curves = [curve(0.6), curve(0.4), curve(0.1)];
        let filter = ColorFilter { pattern: BayerPattern::Grbg, curves, white_balance: true };
        let mosaic = |spec: &mut SensorSpec| spec.quantum_efficiency = Efficiency::Mosaic(filter);
        let lit = behind(0.0, 40.0, 400.0, mosaic);
        let exposer = lit.exposer.as_ref().expect("a sensor");
        assert_eq!([channel_at(exposer, 0, 0), channel_at(exposer, 1, 0)], [Some(Channel::Green), Some(Channel::Red)]);
        let whole = [0, 0, SIZE[0], SIZE[1]];
        let pixels = |channel| regions(&lit, 0, &[whole], channel).expect("a region").regions[0].pixels;
        let all = u64::from(SIZE[0] * SIZE[1]);
        assert_eq!(pixels(None), all);
        assert_eq!([Channel::Red, Channel::Green, Channel::Blue].map(|c| pixels(Some(c))), [all / 4, all / 2, all / 4]);
        // One pixel has one colour.
        assert!(regions(&lit, 0, &[[0, 0, 1, 1]], Some(Channel::Red)).is_err());
        for y in 0..4 {
            let row = f64::from(y);
            let found = line(&lit, 0, [[2.0, row], [9.0, row]], Some(Channel::Blue)).expect("a line");
            assert_eq!(found.values.len(), 8);
        }
        for (place, channel) in [([2.0, 2.0], Channel::Red), ([255.0, 399.0], Channel::Blue)] {
            let [x, y] = nearest(exposer, place, SIZE, Some(channel)).expect("a pixel");
            assert_eq!(channel_at(exposer, x, y), Some(channel));
            assert!((f64::from(x) - place[0]).hypot(f64::from(y) - place[1]) < 1.5);
        }
        let grey = developed(0.0, 40.0, 0.0);
        assert!(regions(&grey, 0, &[whole], Some(Channel::Red)).is_err());
        assert!(line(&grey, 0, [[0.0; 2]; 2], Some(Channel::Red)).is_err());
    }

    /// A region that is not wholly on the image is refused, and not cut to another one.
    #[test]
    fn regions_are_on_the_image() {
        let lit = developed(1e-3, 40.0, 400.0);
        let [width, height] = SIZE;
        let of = |region| regions(&lit, 0, &[region], None);
        assert_eq!(of([0, 0, width, height]).expect("a region").regions[0].pixels, u64::from(width * height));
        for (region, part) in [
            ([0, 0, width + 1, 4], "leaves the image"),
            ([0, 0, 4, height + 1], "leaves the image"),
            ([width, 0, width + 2, 4], "leaves the image"),
            ([0, 0, u32::MAX, u32::MAX], "leaves the image"),
            ([4, 4, 4, 8], "contains no pixel"),
            ([8, 4, 4, 8], "contains no pixel"),
        ] {
            let fault = of(region).expect_err("a fault").to_string();
            assert!(fault.contains(part), "{region:?}: {fault}");
        }
    }

    /// Two regions have the same bins, so that their histograms can be compared.
    #[test]
    fn histograms_of_two_regions_have_common_bins() {
        let lit = developed(1e-3, 40.0, 400.0);
        let found = regions(&lit, 0, &[[0, 0, 4, 400], [200, 0, 256, 400]], None).expect("regions").regions;
        let [a, b] = [&found[0], &found[1]];
        assert_eq!((a.histogram.low, a.histogram.width), (b.histogram.low, b.histogram.width));
        assert_eq!(a.histogram.counts.len(), b.histogram.counts.len());
        assert_eq!(a.histogram.low, u32::from(a.min.min(b.min)));
        for region in [a, b] {
            assert_eq!(region.histogram.counts.iter().sum::<u64>(), region.pixels);
        }
    }

    /// Without a black level the grey value zero cuts the noise of dark pixels off. The slope of the remaining points is K,
    /// and all points lie on the line of the model.
    #[test]
    fn the_photon_transfer_leaves_cut_noise_out() {
        let lit = developed(1.0, 0.0, 0.0);
        let most = lit.exposer.as_ref().expect("a sensor").electrons().data().iter().copied().fold(0.0, f32::max);
        for black_level in [0.0, 64.0] {
            // The brightest column has 100 electrons, 30 DN. Four standard deviations above zero are about 9 DN.
            let transfer = photon_transfer(&developed(100.0 / most, black_level, 0.0)).expect("grey values");
            // The variance of 4000 pixels has a relative standard deviation of 2.2 %. The slope over a range from 55 to 125
            // times K^2 has one of 2.5 %.
            assert!((transfer.line.slope / 0.3 - 1.0).abs() < 0.13, "{black_level}: {:?}", transfer.line);
            assert!((transfer.dark - black_level).abs() < 1e-9);
            for point in &transfer.points {
                let model = 0.09 * 25.0 + 0.3 * (point.mean - black_level) + 1.0 / 12.0;
                assert!((point.variance / model - 1.0).abs() < 0.14, "{black_level}: {point:?}, {model}");
            }
            let lowest = transfer.points.iter().map(|point| point.mean).fold(f64::INFINITY, f64::min);
            assert!(if black_level == 0.0 { lowest > 8.0 } else { lowest < 66.0 }, "{lowest}");
        }
        assert!(photon_transfer(&developed(0.0, 0.0, 0.0)).is_err());
    }
}
