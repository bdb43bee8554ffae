//! Measurements of the frames that are shown: pixels, regions, lines, photon transfer.

use crate::developed::Developed;
use crate::protocol::{
    Fault, HeavyProbe, Histogram, Line, PhotonTransfer, Probe, Region, Regions, TransferLine, TransferPoint,
};
use dunkelfeld::film::Plane;

/// The most values of a line profile.
const MAX_LINE: usize = 4096;
/// The most bins of a histogram.
const MAX_BINS: u32 = 256;
/// Points of a photon transfer, and the fewest pixels of one.
const POINTS: usize = 24;
const LEAST_PIXELS: usize = 64;

fn no_sensor() -> Fault {
    Fault::new("there is no sensor, so there are no grey values", "choose a sensor")
}

/// The values of a pixel. Those of the noise are of the unbiased film behind the same camera.
pub(crate) fn probe(
    developed: &Developed,
    unbiased: &Developed,
    materials: &[String],
    frame: u32,
    [x, y]: [u32; 2],
) -> Result<Probe, Fault> {
    let snapshot = &developed.snapshot;
    let [width, height] = snapshot.size();
    let is_outside = |[width, height]: [u32; 2]| x >= width || y >= height;
    // The film may have changed between the two.
    if is_outside([width, height]) || is_outside(unbiased.snapshot.size()) {
        let problem = format!("the pixel {x}, {y} is outside {width} x {height}");
        return Err(Fault::new(problem, "choose a pixel of the image"));
    }
    let film = snapshot.films().next();
    let sums = snapshot.sums_at(x, y);
    let values = developed.values(frame)?;
    let electrons = developed.exposer.as_ref().map(|exposer| *exposer.electrons().at(x, y));
    let of_film = unbiased.exposer.as_ref();
    let camera_sigma = of_film.map(|exposer| Developed::camera_sigma(exposer, *exposer.electrons().at(x, y)));
    let ratio = unbiased.certified().map(|c| f64::from(*c.ratios.at(x, y)).sqrt()).filter(|ratio| ratio.is_finite());
    let ids = film.and_then(|film| *film.ids.at(x, y));
    let heaviest = snapshot.heaviest(&developed.factors, x, y);
    let depth = sums.mean_depth();
    Ok(Probe {
        x,
        y,
        value: values.map(|values| *values.at(x, y)),
        electrons,
        radiance: *developed.radiance().at(x, y),
        camera_sigma,
        render_sigma: ratio.zip(camera_sigma).map(|(ratio, sigma)| ratio * sigma),
        ratio,
        samples: sums.count(),
        object: ids.and_then(|ids| film?.object_names.get(ids.object() as usize).cloned()),
        material: ids.and_then(|ids| materials.get(ids.material() as usize).cloned()),
        depth: (depth > 0.0).then_some(depth),
        heaviest: heaviest.map(|heaviest| HeavyProbe { index: heaviest.index, share: heaviest.share }),
    })
}

/// The grey values of regions, and the contrast of two.
pub(crate) fn regions(developed: &Developed, frame: u32, regions: &[[u32; 4]]) -> Result<Regions, Fault> {
    if regions.is_empty() || regions.len() > 2 {
        return Err(Fault::new(format!("{} regions were given", regions.len()), "give one or two"));
    }
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
    let values = developed.values(frame)?.ok_or_else(no_sensor)?;
    let found: Vec<Region> =
        regions.iter().map(|region| of_region(developed, &values, *region)).collect::<Result<_, _>>()?;
    let (contrast, cnr) = match &found[..] {
        [a, b] => {
            let contrast = a.mean - b.mean;
            // The noise of a pixel at the mean of the second region, the background.
            let background = (b.mean - exposer.model().spec().offset.0) / exposer.model().spec().system_gain
                - exposer.model().dark_electrons(exposer.exposure().time()).0;
            let sigma = Developed::camera_sigma(exposer, background.max(0.0) as f32);
            (Some(contrast), (sigma > 0.0).then(|| contrast.abs() / sigma))
        }
        _ => (None, None),
    };
    Ok(Regions { regions: found, contrast, cnr })
}

fn of_region(developed: &Developed, values: &Plane<u16>, [x0, y0, x1, y1]: [u32; 4]) -> Result<Region, Fault> {
    let (x1, y1) = (x1.min(values.width()), y1.min(values.height()));
    if x0 >= x1 || y0 >= y1 {
        return Err(Fault::new("the region contains no pixel", "draw a region on the image"));
    }
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
    let model = exposer.model();
    let width = values.width() as usize;
    let rows = values.data().chunks(width).take(y1 as usize).skip(y0 as usize);
    let inside: Vec<u16> = rows.flat_map(|row| &row[x0 as usize..x1 as usize]).copied().collect();
    let n = inside.len() as f64;
    let mean = inside.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let squares: f64 = inside.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum();
    let variance = if n > 1.0 { squares / (n - 1.0) } else { 0.0 };
    let (min, max) = inside.iter().fold((u16::MAX, 0), |(low, high), &v| (low.min(v), high.max(v)));
    let span = u32::from(max - min) + 1;
    let bin = span.div_ceil(MAX_BINS);
    let mut counts = vec![0u64; span.div_ceil(bin) as usize];
    inside.iter().for_each(|&v| counts[(u32::from(v - min) / bin) as usize] += 1);
    let full = model.saturation_value().0.floor() as u16;
    Ok(Region {
        pixels: inside.len() as u64,
        mean,
        variance,
        min,
        max,
        snr: (variance > 0.0).then(|| (mean - model.spec().offset.0) / variance.sqrt()),
        saturated: inside.iter().filter(|&&v| v >= full).count() as f64 / n,
        histogram: Histogram { low: min.into(), width: bin, counts },
    })
}

/// The grey values along a line, from pixel to pixel.
pub(crate) fn line(developed: &Developed, frame: u32, from: [f64; 2], to: [f64; 2]) -> Result<Line, Fault> {
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
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
        let [x, y] = [0, 1].map(|axis| (from[axis] + share * (to[axis] - from[axis])).round() as u32);
        let [x, y] = [x.min(values.width() - 1), y.min(values.height() - 1)];
        let electrons = *exposer.electrons().at(x, y);
        line.values.push(*values.at(x, y));
        line.expected.push(Developed::expected(exposer, electrons));
        line.sigma.push(Developed::camera_sigma(exposer, electrons));
    }
    Ok(line)
}

/// The photon transfer of two frames of one device (EMVA 1288): half of the variance of their differences, over pixels
/// with similar expected grey values.
pub(crate) fn photon_transfer(developed: &Developed) -> Result<PhotonTransfer, Fault> {
    let exposer = developed.exposer.as_ref().ok_or_else(no_sensor)?;
    let model = exposer.model();
    let (a, b) = (exposer.frame(0)?, exposer.frame(1)?);
    let full = model.saturation_value().0;
    let pixels = exposer.electrons().data().iter().map(|&e| Developed::expected(exposer, e));
    let mut pixels: Vec<(f64, f64, f64)> = (pixels.zip(a.data()).zip(b.data()))
        .map(|((expected, &a), &b)| (expected, f64::from(a), f64::from(b)))
        // Saturation cuts the noise off.
        .filter(|(expected, ..)| *expected < 0.9 * full)
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
            "the image has too few grey values below saturation for a photon transfer",
            "shorten the exposure",
        ));
    }
    let slope = products / squares;
    let dark = model.spec().offset.0;
    Ok(PhotonTransfer {
        points,
        gain: model.spec().system_gain,
        line: TransferLine { slope, offset: mean_y - slope * mean_x },
        dark,
    })
}
