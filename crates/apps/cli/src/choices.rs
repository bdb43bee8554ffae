//! Flags with a closed set of values: each value with its name and its help.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use dunkelfeld::DenoiseMethod;

/// Reads one of the values by its name, each with its help or an empty text. Clap has refused every other text before `default` could be the result.
pub(crate) fn one_of<T>(all: Vec<(&'static str, T, &'static str)>, default: T) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync + 'static,
{
    let value = |(name, _, help): &(&'static str, T, &'static str)| match *help {
        "" => PossibleValue::new(*name),
        help => PossibleValue::new(*name).help(help),
    };
    let names: Vec<_> = all.iter().map(value).collect();
    PossibleValuesParser::new(names)
        .map(move |name| all.iter().find(|(known, ..)| *known == name).map_or(default, |(_, value, _)| *value))
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
