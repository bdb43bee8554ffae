//! The shutter of a project: the exposure of its sensor, and the film for which its scene was built.

use dunkelfeld_radiometry::Seconds;
use dunkelfeld_render::{Error, RenderSettings, SensorChoice};
use dunkelfeld_scene::{Scene, Shutter};
use dunkelfeld_sensor::Exposure;

/// The settings with the exposure time of a pixel in the whole shutter: that of all stages of a line scan together.
pub(crate) fn expose_for(mut settings: RenderSettings, shutter: &Shutter) -> Result<RenderSettings, Error> {
    if let SensorChoice::Emva { exposure, .. } = &mut settings.sensor {
        *exposure = Some(Exposure::new(Seconds(shutter.exposure()))?);
    }
    if let Shutter::Lines(lines) = shutter {
        settings.readout.line_scan_stages = lines.stages;
    }
    Ok(settings)
}

/// Refuses a film or an exposure that is not the one for which the scene was built: a line scan has a time for each row,
/// and objects move for the time of the exposure.
pub(crate) fn check_shutter(scene: &Scene, settings: &RenderSettings) -> Result<(), Error> {
    let Some(shutter) = scene.shutter() else { return Ok(()) };
    if let Shutter::Lines(lines) = shutter
        && lines.rows != settings.height
    {
        let problem = format!("the line scan of the job has {} rows", lines.rows);
        return Err(Error::setting("height", problem, "set `height` in [film] of the job"));
    }
    if let SensorChoice::Emva { exposure, .. } = &settings.sensor
        && exposure.map(|e| e.time().0) != Some(shutter.exposure())
    {
        let problem = format!("objects move, or rows are scanned, for an exposure of {} s", shutter.exposure());
        return Err(Error::setting("exposure", problem, "set `exposure` in [sensor] of the job"));
    }
    Ok(())
}
