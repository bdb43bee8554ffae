//! `dunkelfeld sensors`: the presets, and the data sheet that one implies.

use crate::args::SensorsArgs;
use crate::outcome::{Outcome, print};
use dunkelfeld::io::sensor_file;
use dunkelfeld::sensor::{DataSheet, SensorModel, data_sheet};
use std::fmt::Write;

pub(crate) fn run(args: &SensorsArgs) -> Result<Outcome, dunkelfeld::Error> {
    match &args.sensor {
        None => print(&list()?),
        Some(name) => print(&sheet(&dunkelfeld::find_sensor(name)?)),
    }
    Ok(Outcome::Done)
}

fn list() -> Result<String, dunkelfeld::Error> {
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
    text += "\n`dunkelfeld sensors NAME` prints the data sheet that a preset implies.\n";
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
    let published = |v: Option<f64>| v.map_or(String::new(), |v| format!("   (published {v} dB)"));
    let rows = [
        ("pixel pitch", format!("{:.3} um", s.pixel_pitch.0 * 1e6)),
        ("bit depth", s.bit_depth.to_string()),
        ("quantum efficiency eta", format!("{:.1} % at {:.0} nm", d.quantum_efficiency * 100.0, d.wavelength.0)),
        ("system gain K", format!("{:.5} DN/e- ({:.4} e-/DN)", d.system_gain, 1.0 / d.system_gain)),
        ("dark noise sigma_d", format!("{:.3} e-", d.dark_noise.0)),
        ("quantisation noise", format!("{:.3} e-", d.quantisation_noise.0)),
        ("sensitivity threshold", format!("{:.2} e- = {:.2} photons", d.threshold.0, d.threshold_photons)),
        ("saturation capacity", format!("{:.0} e- = {:.0} photons", d.saturation.0, d.saturation_photons)),
        ("dynamic range", format!("{:.2} dB{}", d.dynamic_range_db, published(d.published.dynamic_range_db))),
        ("SNR max", format!("{:.2} dB{}", d.snr_max_db, published(d.published.snr_max_db))),
        ("DSNU", format!("{:.2} e-", d.dsnu.0)),
        ("PRNU", format!("{:.2} %", d.prnu_percent)),
    ];
    for (name, value) in rows {
        let _ = writeln!(text, "  {name:<24}{value}");
    }
    text
}
