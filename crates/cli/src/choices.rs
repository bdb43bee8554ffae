//! Flags with a closed set of values: each value with its name and its help.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use dunkelfeld::DenoiseMethod;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::outputs::Align;
use dunkelfeld::scene::Vignetting;
use dunkelfeld::sensor::ExposureNoise;

/// Reads one of the values by its name. Clap has refused every other text before `default` could be the result.
fn one_of<T>(all: Vec<(&'static str, T, &'static str)>, default: T) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync + 'static,
{
    let names: Vec<_> = all.iter().map(|(name, _, help)| PossibleValue::new(*name).help(*help)).collect();
    PossibleValuesParser::new(names)
        .map(move |name| all.iter().find(|(known, ..)| *known == name).map_or(default, |(_, value, _)| *value))
}

/// Strategies of `--allocate`.
pub(crate) fn strategies() -> impl TypedValueParser<Value = Strategy> {
    let help = |strategy| match strategy {
        Strategy::Uniform => "The same number everywhere",
        Strategy::Sobel => "In proportion to the Sobel magnitude of a pilot image (Kludt et al.)",
        Strategy::Sensor => "More where the noise of the render is large beside that of the sensor",
    };
    one_of(Strategy::ALL.map(|s| (s.name(), s, help(s))).to_vec(), Strategy::Uniform)
}

/// Denoisers of `--denoise`.
pub(crate) fn denoisers() -> impl TypedValueParser<Value = DenoiseMethod> {
    let help = |method| match method {
        DenoiseMethod::Off => "No denoiser",
        DenoiseMethod::Auto => "Intel Open Image Denoise if this machine has it, else the built-in filter",
        DenoiseMethod::Oidn => "Intel Open Image Denoise",
        DenoiseMethod::Builtin => "The built-in filter: needs no library, and uses the variance of each pixel",
    };
    one_of(DenoiseMethod::ALL.map(|m| (m.name(), m, help(m))).to_vec(), DenoiseMethod::Off)
}

/// The noise of an exposure, for `--exposure-noise`.
pub(crate) fn exposure_noises() -> impl TypedValueParser<Value = ExposureNoise> {
    let help = |noise| match noise {
        ExposureNoise::Plain => "All of the camera's noise, in addition to that of the render",
        ExposureNoise::Matched => {
            "The camera's noise less that of the render, so that frames of independent renders have the noise of the camera. The output states the share of pixels for which that holds; the EXR of a render has it as layer matched.Y"
        }
    };
    let all = [ExposureNoise::Plain, ExposureNoise::Matched];
    one_of(all.map(|n| (n.name(), n, help(n))).to_vec(), ExposureNoise::Plain)
}

/// The place of the bits of grey values, for `--align`.
pub(crate) fn alignments() -> impl TypedValueParser<Value = Align> {
    let all = [
        ("right", Align::Right, "The lowest bits: the number is the grey value, as in Mono12 of GenICam"),
        ("left", Align::Left, "The highest bits: the number is the grey value times a power of two"),
    ];
    one_of(all.to_vec(), Align::Right)
}

/// Vignetting, for `--vignetting`.
pub(crate) fn vignettings() -> impl TypedValueParser<Value = Vignetting> {
    let help = |vignetting| match vignetting {
        Vignetting::None => "Not at all, as a lens that is corrected for it, or an image after flat-field correction",
        Vignetting::CosineFourth => "With the fourth power of the cosine of the field angle, as a thin lens",
    };
    let all = [Vignetting::None, Vignetting::CosineFourth];
    one_of(all.map(|v| (v.name(), v, help(v))).to_vec(), Vignetting::None)
}
