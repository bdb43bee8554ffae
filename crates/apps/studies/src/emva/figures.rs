//! The plots of the standard.

use dunkelfeld_emva1288::{Analysis, GeneralAnalysis, Histogram, Nonuniformity, Profile, Spectrogram};
use dunkelfeld_report::chart::Chart;
use dunkelfeld_report::chart::plot::{Axis, Style, Trace, draw};

const PHOTONS: &str = "photons per pixel \u{3bc}p";
/// Number of points at which a model is drawn.
const STEPS: u32 = 120;

const fn linear(label: &str) -> Axis<'_> {
    Axis { label, is_log: false, has_zero: true }
}

const fn free(label: &str) -> Axis<'_> {
    Axis { label, is_log: false, has_zero: false }
}

const fn log(label: &str) -> Axis<'_> {
    Axis { label, is_log: true, has_zero: false }
}

fn trace(color: usize, name: &str, style: Style, points: Vec<[f64; 2]>) -> Trace {
    Trace { color, name: name.into(), style, points }
}

/// A chart with its caption.
pub(super) struct Figure {
    pub(super) chart: Chart,
    pub(super) caption: String,
}

fn figure(chart: Chart, caption: impl Into<String>) -> Figure {
    Figure { chart, caption: caption.into() }
}

/// Sensitivity, photon transfer, signal-to-noise ratio, linearity, dark current.
pub(super) fn sensitivity(a: &Analysis) -> Vec<Figure> {
    let used = a.levels.iter().filter(|l| l.is_used).map(|l| l.signal).fold(0.0, f64::max);
    let (gain, response) = (a.value("K"), a.value("R"));
    let points = |y: fn(&dunkelfeld_emva1288::LevelPoint) -> [f64; 2]| a.levels.iter().map(y).collect::<Vec<_>>();
    let transfer = draw(
        "photon-transfer",
        "photon transfer",
        [
            linear("\u{3bc}y \u{2212} \u{3bc}y.dark [DN]"),
            linear("\u{3c3}y\u{b2} \u{2212} \u{3c3}y.dark\u{b2} [DN\u{b2}]"),
        ],
        &[
            trace(0, "measured", Style::Points, points(|l| [l.signal, l.variance - l.dark_variance])),
            trace(1, "slope K, 0 to 70 %", Style::Line, vec![[0.0, 0.0], [used, gain * used]]),
        ],
    );
    let last = used / response;
    let sensitivity = draw(
        "sensitivity",
        "sensitivity",
        [linear(PHOTONS), linear("\u{3bc}y \u{2212} \u{3bc}y.dark [DN]")],
        &[
            trace(0, "measured", Style::Points, points(|l| [l.photons, l.signal])),
            trace(1, "slope R, 0 to 70 %", Style::Line, vec![[0.0, 0.0], [last, used]]),
        ],
    );
    let (least, most) = (a.value("mu_p.min"), a.value("mu_p.sat"));
    let at = |k: u32| least * (most / least).powf(f64::from(k) / f64::from(STEPS));
    let model = |which: usize| (0..=STEPS).map(|k| [at(k), a.snr(at(k))[which]]).collect::<Vec<_>>();
    let measured = a.levels.iter().filter(|l| l.photons <= most).map(|l| [l.photons, l.snr]).collect();
    let mut traces = vec![trace(1, "linear model", Style::Line, model(0))];
    if a.nonuniformity.is_some() {
        traces.push(trace(2, "total, with DSNU and PRNU", Style::Line, model(1)));
    }
    let ideal = [least, most].map(|p| [p, p.sqrt()]).to_vec();
    traces.push(trace(3, "ideal sensor", Style::Dashed, ideal));
    traces.push(trace(0, "measured", Style::Points, measured));
    let snr = draw("snr", "signal-to-noise ratio", [log(PHOTONS), log("SNR")], &traces);
    let l = &a.linearity;
    let range = l.range[0]..l.range[1];
    let deviations: Vec<[f64; 2]> =
        a.levels.iter().zip(&l.deviations).map(|(p, d)| [p.photons, *d]).collect::<Vec<_>>()[range].to_vec();
    let ends = [deviations.first(), deviations.last()].into_iter().flatten().map(|p| [p[0], 0.0]).collect();
    let deviation = draw(
        "linearity",
        "deviation from linearity",
        [linear(PHOTONS), linear("deviation [%]")],
        &[trace(0, "measured", Style::Points, deviations), trace(1, "straight line", Style::Dashed, ends)],
    );
    let mut figures = vec![
        figure(transfer, "Photon transfer: the temporal variance grows with the mean by the gain K (equation 50)."),
        figure(sensitivity, "Sensitivity: the mean grows with the light by the responsivity R."),
        figure(
            snr,
            "Signal-to-noise ratio (equation 21), from the sensitivity threshold to saturation. The ideal sensor counts every photon.",
        ),
        figure(
            deviation,
            format!(
                "Linearity: deviation from the line through 5 to 95 % of saturation; LE = {:.3} %, between {:+.3} and {:+.3} %.",
                l.error, l.least[0], l.most[0]
            ),
        ),
    ];
    figures.extend(dark_current(a));
    figures
}

/// Mean and variance of dark frames over the exposure time; none with a single time.
fn dark_current(a: &Analysis) -> Vec<Figure> {
    if a.darks.len() < 2 {
        return Vec::new();
    }
    let gain = a.value("K");
    let longest = a.darks.iter().map(|d| d.exposure).fold(0.0, f64::max);
    let dark = |name: &str, y: &str, of: fn(&dunkelfeld_emva1288::DarkPoint) -> f64, [start, slope]: [f64; 2]| {
        let points = a.darks.iter().map(|d| [1e3 * d.exposure, of(d)]).collect();
        let mut traces = vec![trace(0, "dark", Style::Points, points)];
        // Without enough exposure times there is no dark current to draw.
        if slope.is_finite() {
            let line = [0.0, longest].map(|t| [1e3 * t, start + slope * t]).to_vec();
            traces.push(trace(1, "dark current", Style::Line, line));
        }
        draw(name, name, [linear("exposure time [ms]"), free(y)], &traces)
    };
    let mean_line = [a.value("mu_y.dark"), gain * a.value("mu_I.mean")];
    let variance_line = [a.value("sigma_y.dark").powi(2), gain * gain * a.value("mu_I.var")];
    let mean = dark("dark-mean", "\u{3bc}y.dark [DN]", |d| d.mean[0], mean_line);
    let variance = dark("dark-variance", "\u{3c3}y.dark\u{b2} [DN\u{b2}]", |d| d.variance[0], variance_line);
    vec![
        figure(mean, "Dark current: the dark grey value over the exposure time."),
        figure(variance, "Dark noise: its variance over the exposure time."),
    ]
}

/// Spectrograms, profiles, histograms.
pub(super) fn nonuniformity(n: &Nonuniformity, gain: f64) -> [Vec<Figure>; 3] {
    let mut spectra = Vec::new();
    let mut profiles = Vec::new();
    for (light, pair, lines) in
        [("dark", &n.dark_spectrograms, &n.dark_profiles), ("50 %", &n.bright_spectrograms, &n.bright_profiles)]
    {
        for ((way, s), p) in ["horizontal", "vertical"].into_iter().zip(pair).zip(lines) {
            let name = format!("spectrogram-{}-{way}", if light == "dark" { "dark" } else { "bright" });
            spectra.push(figure(spectrogram(&name, s, gain), format!("Spectrogram, {way}, {light}.")));
            let name = format!("profile-{}-{way}", if light == "dark" { "dark" } else { "bright" });
            profiles
                .push(figure(profile(&name, p), format!("Profile, {way}, {light}: over the mean image of the stack.")));
        }
    }
    let mut histograms = Vec::new();
    for (name, what, h) in [("dsnu", "Dark pixels", &n.dark_histogram), ("prnu", "Responses", &n.response_histogram)] {
        if let Some(h) = h {
            histograms.push(figure(
                histogram(name, h),
                format!("{what}: how many deviate by how much, beside a normal distribution of the same spread."),
            ));
            histograms.push(figure(
                accumulated(name, h),
                format!("{what}: the share that deviates by at least so much, to either side."),
            ));
        }
    }
    [spectra, profiles, histograms]
}

fn spectrogram(name: &str, s: &Spectrogram, gain: f64) -> Chart {
    // The mean was subtracted, so that the remainder at frequency zero is the means of the lines.
    let points: Vec<[f64; 2]> =
        s.amplitude.iter().enumerate().skip(1).map(|(k, a)| [s.frequency(k), a / gain]).collect();
    let ends = [0.0, 0.5].map(|f| [f, s.noise / gain]).to_vec();
    draw(
        name,
        "spectrogram",
        [linear("cycles per pixel"), log("standard deviation [e\u{207b}]")],
        &[trace(0, "spectrum", Style::Line, points), trace(1, "noise left in the stack", Style::Dashed, ends)],
    )
}

fn profile(name: &str, p: &Profile) -> Chart {
    let points = |v: &[f64]| v.iter().enumerate().map(|(i, y)| [i as f64, *y]).collect::<Vec<_>>();
    draw(
        name,
        "profile",
        [linear("pixel"), free("grey value [DN]")],
        &[
            trace(4, "largest", Style::Line, points(&p.most)),
            trace(4, "smallest", Style::Line, points(&p.least)),
            trace(5, "middle line", Style::Line, points(&p.middle)),
            trace(0, "mean", Style::Line, points(&p.mean)),
        ],
    )
}

fn histogram(name: &str, h: &Histogram) -> Chart {
    let counts = h.counts.iter().enumerate().map(|(i, c)| [h.at(i), *c as f64]).collect();
    // Less than half a pixel counts as none.
    let model = (0..h.counts.len()).map(|i| [h.at(i), h.model(i)]).filter(|p| p[1] >= 0.5).collect();
    let axis = format!("deviation [{}]", h.unit);
    draw(
        &format!("histogram-{name}"),
        "logarithmic histogram",
        [free(&axis), log("pixels")],
        &[trace(0, "pixels", Style::Line, counts), trace(1, "normal", Style::Dashed, model)],
    )
}

fn accumulated(name: &str, h: &Histogram) -> Chart {
    let least = 100.0 / h.pixels as f64;
    let at = |k: usize| k as f64 * h.bin;
    let shares = h.accumulated.iter().enumerate().map(|(k, s)| [at(k), *s]).collect();
    let model =
        (0..h.accumulated.len()).map(|k| [at(k), h.accumulated_model(at(k))]).filter(|p| p[1] >= 0.5 * least).collect();
    let axis = format!("deviation [{}]", h.unit);
    draw(
        &format!("accumulated-{name}"),
        "accumulated histogram",
        [linear(&axis), log("share of the pixels [%]")],
        &[trace(0, "pixels", Style::Line, shares), trace(1, "normal", Style::Dashed, model)],
    )
}

/// The plots of the general module.
pub(super) fn general(a: &GeneralAnalysis) -> Vec<Figure> {
    let points = |y: fn(&dunkelfeld_emva1288::InputPoint) -> f64| {
        a.levels.iter().map(|l| [l.photons, y(l)]).collect::<Vec<[f64; 2]>>()
    };
    let one = |name: &str, title: &str, axes: [Axis<'_>; 2], of: fn(&dunkelfeld_emva1288::InputPoint) -> f64| {
        draw(name, title, axes, &[trace(0, "measured", Style::Points, points(of))])
    };
    let snr = draw(
        "snr",
        "signal-to-noise ratio at the input",
        [log(PHOTONS), log("SNR at the input")],
        &[
            trace(0, "measured", Style::Points, points(|l| l.snr)),
            trace(3, "ideal sensor", Style::Dashed, points(|l| l.photons.sqrt())),
        ],
    );
    vec![
        figure(
            one(
                "curve",
                "characteristic curve",
                [linear(PHOTONS), linear("\u{3bc}y \u{2212} \u{3bc}y.dark [DN]")],
                |l| l.signal,
            ),
            "Characteristic curve.",
        ),
        figure(
            one("slope", "slope", [linear(PHOTONS), linear("slope [DN/photon]")], |l| l.slope),
            "Its slope, by which noise is referred to the input.",
        ),
        figure(
            one("noise", "noise at the input", [linear(PHOTONS), linear("noise \u{3c3}p [photons]")], |l| l.noise[0]),
            "Temporal noise at the input.",
        ),
        figure(snr, "Signal-to-noise ratio at the input."),
    ]
}
