//! `dunkelfeld emva`: writes data sets, and computes figures from them.

use super::emva_args::{AnalyseArgs, DatasetArgs, EmvaArgs, EmvaCommand};
use crate::outcome::{Outcome, print, say};
use dunkelfeld::Error;
use dunkelfeld::radiometry::{Nanometres, Seconds};
use dunkelfeld_studies::emva::{
    AnalyseOptions, DatasetPlan, DatasetSettings, Findings, TRUTH, read_measurement, write_dataset,
};

pub(crate) fn run(args: &EmvaArgs) -> Result<Outcome, Error> {
    match &args.command {
        EmvaCommand::Dataset(args) => dataset(args),
        EmvaCommand::Analyse(args) => analyse(args),
    }
}

fn dataset(args: &DatasetArgs) -> Result<Outcome, Error> {
    let model = dunkelfeld::find_sensor(&args.sensor)?;
    let settings = DatasetSettings::default()
        .with_levels(args.levels)
        .with_width(args.size[0])
        .with_height(args.size[1])
        .with_wavelength(args.wavelength.map(Nanometres))
        .with_stack(args.spatial)
        .with_vary(args.vary)
        .with_exposure(Seconds(args.exposure))
        .with_bit_depth(args.bit_depth)
        .with_color(args.color)
        .with_seed(args.seed);
    let plan = DatasetPlan::new(&model, &settings)?;
    let Some(written) = args.run.work(|session| write_dataset(&plan, &args.output, session))? else {
        return Ok(Outcome::Interrupted);
    };
    print(&format!(
        "{}\n{} frames of {} x {} pixels, {} levels of light at {} nm\nwrote {} and {}\n",
        model.spec().name,
        written.frames,
        settings.width,
        settings.height,
        settings.levels,
        written.truth.wavelength_nm,
        written.descriptor.display(),
        args.output.join(TRUTH).display()
    ));
    Ok(Outcome::Done)
}

fn analyse(args: &AnalyseArgs) -> Result<Outcome, Error> {
    let options = AnalyseOptions::default()
        .with_release(args.release)
        .with_general(args.general)
        .with_pixel_pitch(args.pixel_pitch)
        .with_wavelength(args.wavelength)
        .with_sensor(args.sensor.clone())
        .with_maps(args.maps);
    Findings::check_outputs(&args.input, &options, args.json.as_deref(), args.html.as_deref())?;
    let Some(read) = args.run.work(|session| read_measurement(&args.input, session))? else {
        return Ok(Outcome::Interrupted);
    };
    let findings = options.analyse(&read)?;
    for line in read.warnings.iter().chain(findings.notes()) {
        say(&format!("note: {line}"));
    }
    let mut text = findings.table();
    for path in findings.save_sensor(&read, &options)? {
        text += &format!("wrote {}\n", path.display());
    }
    if let Some(path) = &args.json {
        findings.save_json(path)?;
        text += &format!("wrote {}\n", path.display());
    }
    if let Some(path) = &args.html {
        findings.save_html(&read, path)?;
        text += &format!("wrote {}\n", path.display());
    }
    print(&text);
    Ok(Outcome::Done)
}
