//! The jobs that render the scenes.

use super::part::Cover;

/// The job of the paper's experiments: the scene with the moulded cover, with fewer pixels.
pub(crate) const PAPER: &str = r#"# The experiments of Kludt et al., "Noise analysis of a synthetically rendered scene in sensor-realistic image simulation":
#
#     dunkelfeld ptc scenes/inspection/paper.toml
#
# renders 50 frames with 64 samples per pixel and 50 with 2500, with seeds of their own, and as many for the sensor.
# Written by `cargo xtask scenes`. Any value can be changed here; `ptc --help` has the flags of the experiments.

scene = "inspection.glb"
camera = "camera"

[film]
width = 64              # the time for 200 frames is in proportion to the number of pixels
height = 64

[sensor]
model = "imx250"
exposure = "auto"       # that of the first frame with 2500 samples, for all

[[material]]
name = "pmma"
ior = 1.49
"#;

/// The TOML of one job.
pub(crate) fn job(stem: &str, cover: Cover) -> String {
    let what = match cover {
        Cover::Moulded => "a moulded PMMA cover: gently bulged faces, rounded rim, smooth normals",
        Cover::Flat => "a plane-parallel PMMA cover",
        Cover::None => "no cover: the film and its symbols lie open",
    };
    let mut text = format!(
        r#"# Dark-field inspection of a moulded control panel with {what}.
# Written by `cargo xtask scenes`. Any value can be changed here; the scene itself is made by code in xtask/src/scenes.

scene = "{stem}.glb"
camera = "camera"

[film]
width = 512
height = 512

[budget]
time = "20s"            # wall clock for the whole command; `spp = 64` is a budget by samples, `noise = 0.7` one by accuracy

[allocate]
strategy = "sensor"     # most samples where the sensor does not hide the noise; "sobel": at edges of a pilot image (the paper)

[sensor]
model = "imx250"
exposure = "auto"       # the 99.5 % quantile comes to 90 % of saturation

[output]
image = "{stem}.png"
"#
    );
    if cover != Cover::None {
        text.push_str(
            r#"
[[material]]
name = "pmma"           # overrides the scene's material of this name
ior = 1.49
"#,
        );
    }
    text.push_str(
        r#"
# A light of the scene by name: radiance in W/(m^2 sr) per channel.
# [[light]]
# name = "light-rear"
# radiance = [20.0, 20.0, 20.0]
"#,
    );
    text
}
