//! The data sheet of a sensor as data: that of `dunkelfeld sensors --json`.

use dunkelfeld_sensor::{ChannelSheet, Figure, SensorModel, data_sheet};
use serde_json::{Value, json};

/// The data sheet that a sensor implies, beside the published one: source, pixel pitch \[um\], bit depth, offset \[DN\], channels
/// with their wavelength \[nm\], quantum efficiency \[%\] and photons at threshold and saturation, and figures with their unit.
/// `name` is the name by which the sensor was found.
pub fn sensor_sheet(name: &str, model: &SensorModel) -> Value {
    let (s, d) = (model.spec(), data_sheet(model));
    let channel = |c: &ChannelSheet| {
        json!({
            "color": c.color.map(|color| color.name()),
            "wavelength_nm": c.wavelength.0,
            "quantum_efficiency_percent": 100.0 * c.quantum_efficiency,
            "threshold_p": c.threshold_photons,
            "saturation_p": c.saturation_photons,
        })
    };
    let figure = |f: Figure| {
        json!({
            "key": f.key,
            "name": f.name,
            "symbol": f.symbol,
            "unit": f.unit,
            "model": f.implied,
            "published": f.published,
            "difference": f.published.map(|p| f.implied - p),
        })
    };
    json!({
        "sensor": name,
        "name": s.name,
        "source": s.source,
        "derived": s.derived,
        "assumed": s.assumed,
        "pixel_pitch_um": s.pixel_pitch.0 * 1e6,
        "bit_depth": s.bit_depth,
        "offset_dn": s.offset.0,
        "color_filter": s.quantum_efficiency.filter().map(|f| f.pattern.name()),
        "channels": d.channels.iter().map(channel).collect::<Vec<_>>(),
        "figures": d.figures().into_iter().map(figure).collect::<Vec<_>>(),
    })
}
