//! The numbers of a bench, table by table.

use super::hidden::growth;
use super::results::{OFF, Point, Results};
use crate::report::estimate::Estimate;
use crate::report::table::{Cell, Table, column, estimate};

/// All tables of a report.
pub(super) fn tables(r: &Results) -> [Table; 5] {
    [noise(r), hidden(r), denoised(r), stages(r), effects(r)]
}

fn noise(r: &Results) -> Table {
    let has_sensor = r.view.has_sensor();
    let mut columns = vec![
        column("strategy", "strategy", ""),
        column("spp", "samples", "per pixel"),
        column("seeds", "renders", ""),
        estimate("seconds", "time", "s"),
        estimate("variance_picture", "variance, 8-bit picture", "DN\u{b2}"),
        estimate(
            "variance_signal",
            "variance, linear",
            if has_sensor { "e\u{207b}\u{b2}" } else { "(W/(m\u{b2} sr))\u{b2}" },
        ),
        column("stated_over_measured", "stated / measured", ""),
    ];
    if has_sensor {
        columns.insert(6, estimate("variance_over_sensor", "over the sensor\u{2019}s, v/s", ""));
        columns.push(column("hidden_half", "hidden at k = 0.5", "share"));
    }
    let rows = r.points.iter().map(|p| {
        let mut row = vec![
            Cell::Text(p.strategy.name().into()),
            Cell::Count(p.spp.into()),
            Cell::Count(p.seeds as u64),
            Cell::Estimate(p.seconds),
            Cell::Estimate(p.picture),
            Cell::Estimate(p.signal),
        ];
        row.extend(p.ratio.map(Cell::Estimate));
        row.push(Cell::Number(p.stated));
        row.extend(p.hidden.map(Cell::Number));
        row
    });
    Table { name: "noise", columns, rows: rows.collect() }
}

fn denoised(r: &Results) -> Table {
    let has_sensor = r.view.has_sensor();
    let unit = if has_sensor { "over the sensor\u{2019}s variance" } else { "(W/(m\u{b2} sr))\u{b2}" };
    let columns = vec![
        column("strategy", "strategy", ""),
        column("denoiser", "denoiser", ""),
        column("spp", "samples", "per pixel"),
        column("seeds", "renders", ""),
        estimate("seconds", "time", "s"),
        estimate("variance_picture", "variance, 8-bit picture", "DN\u{b2}"),
        estimate("squared_error", "squared error", unit),
        column("error_over_off", "over that without", ""),
        column("noise_share", "of which noise", "%"),
    ];
    let off = |p: &Point| {
        let same = |q: &&Point| (q.strategy, q.spp, q.denoiser) == (p.strategy, p.spp, OFF);
        r.denoised.iter().find(same).and_then(|q| q.squared_error).map_or(f64::NAN, |e| e.value)
    };
    let rows = r.denoised.iter().map(|p| {
        let error = p.squared_error.unwrap_or(Estimate { value: f64::NAN, error: f64::NAN });
        let noise = p.ratio.unwrap_or(p.signal);
        vec![
            Cell::Text(p.strategy.name().into()),
            Cell::Text(p.denoiser.into()),
            Cell::Count(p.spp.into()),
            Cell::Count(p.seeds as u64),
            Cell::Estimate(p.seconds),
            Cell::Estimate(p.picture),
            Cell::Estimate(error),
            Cell::Number(error.value / off(p)),
            Cell::Number(100.0 * noise.value / error.value),
        ]
    });
    Table { name: "denoised", columns, rows: rows.collect() }
}

fn hidden(r: &Results) -> Table {
    let columns = vec![
        column("k", "k", ""),
        column("noise_growth", "total noise", "% above the sensor\u{2019}s"),
        column("strategy", "strategy", ""),
        estimate("spp", "samples", "per pixel"),
        estimate("seconds", "time", "s"),
        column("over_best", "over the best", ""),
    ];
    let mut rows = Vec::new();
    for (i, &k) in r.settings.levels().iter().enumerate() {
        let prices = || r.tops.iter().filter_map(|t| Some((t.strategy, t.prices.get(i)?)));
        let best = prices().map(|(_, p)| p.seconds.value).fold(f64::INFINITY, f64::min);
        rows.extend(prices().map(|(strategy, p)| {
            vec![
                Cell::Number(k),
                Cell::Number(100.0 * growth(k)),
                Cell::Text(strategy.name().into()),
                Cell::Estimate(p.spp),
                Cell::Estimate(p.seconds),
                Cell::Number(p.seconds.value / best),
            ]
        }));
    }
    Table { name: "hidden", columns, rows }
}

fn stages(r: &Results) -> Table {
    let columns = vec![
        column("strategy", "strategy", ""),
        column("spp", "samples", "per pixel"),
        column("stage", "stage", ""),
        column("seconds", "time", "s"),
        column("share", "share", "%"),
    ];
    let rows = r.tops.iter().flat_map(|t| {
        let total: f64 = t.stages.iter().map(|s| s.1).sum();
        t.stages.iter().map(move |(stage, seconds)| {
            vec![
                Cell::Text(t.strategy.name().into()),
                Cell::Count(t.spp.into()),
                Cell::Text(stage.clone()),
                Cell::Number(*seconds),
                Cell::Number(100.0 * seconds / total),
            ]
        })
    });
    Table { name: "stages", columns, rows: rows.collect() }
}

fn effects(r: &Results) -> Table {
    let unit = if r.view.has_sensor() { "DN" } else { "W/(m\u{b2} sr)" };
    let gain = r.view.gain().unwrap_or(1.0);
    let mut columns = vec![
        column("effect", "left out", ""),
        column("seeds", "renders", ""),
        estimate("seconds_saved", "time saved", "s"),
        column("share_saved", "of the whole", "%"),
        estimate("bias_mean", "bias, mean", unit),
        column("bias_p99", "bias, 99 %", unit),
        column("bias_p99_noise", "of which noise", unit),
    ];
    if r.view.has_sensor() {
        columns.extend([
            column("sigma_rms", "bias, rms", "sensor \u{3c3}"),
            column("sigma_p99", "bias, 99 %", "sensor \u{3c3}"),
            column("sigma_p99_noise", "of which noise", "sensor \u{3c3}"),
            column("visible", "visible to this camera?", ""),
        ]);
    }
    let rows = r.ablations.iter().map(|a| {
        let b = &a.bias;
        let mut row = vec![
            Cell::Text(a.effect.name().into()),
            Cell::Count(a.seeds as u64),
            Cell::Estimate(a.saved),
            Cell::Number(100.0 * a.saved.value / a.whole.value),
            Cell::Estimate(b.mean.scaled(gain)),
            Cell::Number(b.p99 * gain),
            Cell::Number(b.noise * gain),
        ];
        if let Some(verdict) = b.verdict {
            row.extend([b.rms_sigma, b.p99_sigma, b.noise_sigma].map(Cell::Number));
            row.push(Cell::Text(verdict.words().into()));
        }
        row
    });
    Table { name: "effects", columns, rows: rows.collect() }
}
