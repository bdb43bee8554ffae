//! `dunkelfeld sensors`: lists the presets, and compares the data sheet that one implies with the published one.

use crate::args::SensorsArgs;
use crate::outcome::{Outcome, print};
use crate::words::exposure_time;
use dunkelfeld::Error;
use dunkelfeld::commands::sensor_sheet;
use dunkelfeld::io::sensor_file;
use dunkelfeld::sensor::{DataSheet, Figure, SensorModel, data_sheet};
use serde_json::Value;
use std::fmt::Write;

pub(crate) fn run(args: &SensorsArgs) -> Result<Outcome, Error> {
    let text = match (&args.sensor, args.json) {
        (None, false) => list()?,
        (None, true) => {
            let presets =
                sensor_file::preset_names().map(|name| Ok(sensor_sheet(name, &dunkelfeld::find_sensor(name)?)));
            pretty(&Value::Array(presets.collect::<Result<_, Error>>()?))
        }
        (Some(name), false) => sheet(&dunkelfeld::find_sensor(name)?),
        (Some(name), true) => pretty(&sensor_sheet(name, &dunkelfeld::find_sensor(name)?)),
    };
    print(&text);
    Ok(Outcome::Done)
}

fn list() -> Result<String, Error> {
    let mut text = String::from("name                pixel      saturation  dark noise  gain        source\n");
    for name in sensor_file::preset_names() {
        let model = sensor_file::preset(name)?;
        let s = model.spec();
        let _ = writeln!(
            text,
            "{name:<18}  {:>5.3} um  {:>7.0} e-  {:>7.2} e-  {:>6.3} e-/DN  {}",
            s.pixel_pitch.0 * 1e6,
            model.saturation().0,
            s.dark_noise.0,
            1.0 / s.system_gain,
            s.source
        );
    }
    text += "\n`dunkelfeld sensors NAME` prints the data sheet of a preset.\n";
    Ok(text)
}

fn sheet(model: &SensorModel) -> String {
    let s = model.spec();
    let d: DataSheet = data_sheet(model);
    let mut text = format!("{}\n  source: {}\n", s.name, s.source);
    for (what, names) in [("derived", &s.derived), ("assumed", &s.assumed)] {
        if !names.is_empty() {
            let _ = writeln!(text, "  {what}: {}", names.join(", "));
        }
    }
    let pitch = s.pixel_pitch.0 * 1e6;
    let _ = writeln!(text, "  pixel pitch {pitch:.3} um, {} bit, black level {} DN", s.bit_depth, s.offset.0);
    for (what, time) in [("shortest", s.min_exposure), ("longest", s.max_exposure)] {
        if let Some(time) = time {
            let _ = writeln!(text, "  {what} exposure {}", exposure_time(time.0));
        }
    }
    if let Some(filter) = s.quantum_efficiency.filter() {
        let _ = writeln!(text, "  colour filter {}", filter.pattern.name());
    }
    for c in &d.channels {
        let color = c.color.map_or(String::new(), |color| format!("{}: ", color.name()));
        let _ = writeln!(
            text,
            "  {color}quantum efficiency {} % at {:.0} nm, {} to {} photons",
            digits(100.0 * c.quantum_efficiency),
            c.wavelength.0,
            digits(c.threshold_photons),
            digits(c.saturation_photons)
        );
    }
    let _ = writeln!(text, "\n  {:<24}{:<12}{:>16}{:>12}   difference", "figure", "symbol", "model", "published");
    for f in d.figures() {
        let published = f.published.map_or("-".into(), digits);
        let (what, model) = (format!("{:<24}{:<12}", f.name, f.symbol), format!("{} {}", digits(f.implied), f.unit));
        let line = format!("  {what}{model:>16}{published:>12}   {}", difference(&f));
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

/// Difference of the model from the published value: in dB for decibels, otherwise in percent.
fn difference(f: &Figure) -> String {
    match f.published {
        None => String::new(),
        Some(p) if f.unit == "dB" => format!("{:+.2} dB", f.implied - p),
        Some(p) => format!("{:+.1} %", 100.0 * (f.implied / p - 1.0)),
    }
}

/// Four digits, without trailing zeros.
fn digits(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    let decimals = (3 - v.abs().log10().floor() as i32).clamp(0, 8) as usize;
    let text = format!("{v:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}
