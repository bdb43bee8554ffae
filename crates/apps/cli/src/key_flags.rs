//! Flags that are keys of a job: each is a row of [`KEYS`](dunkelfeld::io::KEYS), so its help, its values and its limits are
//! those of the job file.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser, ValueParser};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use dunkelfeld::io::{Key, Kind};
use std::fmt::Debug;
use std::marker::PhantomData;

/// The flags of a command.
pub(crate) trait FlagSet: Debug {
    /// Names of flags, without dashes.
    const FLAGS: &'static [&'static str];
    /// Help texts of flags that have another default here than in a render.
    const HELP: &'static [(&'static str, &'static str)] = &[];
}

macro_rules! flag_sets {
    ($($name:ident = $flags:expr $(, $help:expr)?;)+) => {
        $(
            #[doc = concat!("The flags `", stringify!($flags), "`.")]
            #[derive(Debug)]
            pub(crate) struct $name;

            impl FlagSet for $name {
                const FLAGS: &'static [&'static str] = $flags;
                $(const HELP: &'static [(&'static str, &'static str)] = $help;)?
            }
        )+
    };
}

flag_sets! {
    OfRender = dunkelfeld::io::OF_RENDER;
    OfMerge = dunkelfeld::io::OF_MERGE, &[("output", "The picture: PNG, 8 bit, gamma 2.2, clipped at saturation")];
    OfExpose = dunkelfeld::io::OF_IMAGE, &[
        ("output", "The picture: PNG, 8 bit, gamma 2.2, clipped at saturation. Of several frames each gets its number, as in \
                    out-0007.png [default: the input's name with .png, in this folder, unless --linear is given]"),
        ("sensor", "Sensor preset, or a sensor file (.toml) [default: that of the render, if the file contains it; imx250]"),
        ("exposure-noise", "Noise that the exposure adds to that of the image [default: plain]. Matched needs a layer \
                            `variance`, and is for one frame"),
        ("vignetting", "Vignetting of the lens [default: none]. cos4 needs --focal-length, and is not for images that were \
                        rendered with it"),
    ];
}

#[cfg(feature = "studies")]
flag_sets! { OfStudy = dunkelfeld::io::OF_STUDY; }

#[cfg(feature = "view")]
flag_sets! { OfLens = dunkelfeld::io::OF_LENS; }

/// A flag as it was written, and the line of the job that it stands for.
#[derive(Clone, Debug)]
struct Given {
    value: String,
    line: String,
}

/// The flags of a set that were given.
#[derive(Debug)]
pub(crate) struct KeyFlags<S> {
    given: Vec<(&'static str, Given)>,
    set: PhantomData<S>,
}

impl<S> KeyFlags<S> {
    /// The lines of a job that the flags stand for.
    pub(crate) fn keys(&self) -> String {
        self.given.iter().map(|(_, given)| given.line.as_str()).collect()
    }

    /// The lines of files to write, and the other ones.
    pub(crate) fn files_and_others(&self) -> [String; 2] {
        let lines = |of_files: bool| {
            let lines = self.given.iter().map(|(_, given)| given.line.as_str());
            lines.filter(|line| line.starts_with("output.") == of_files).collect()
        };
        [true, false].map(lines)
    }

    /// The value of a flag as it was written.
    pub(crate) fn value(&self, flag: &str) -> Option<&str> {
        self.given.iter().find(|(name, _)| *name == flag).map(|(_, given)| given.value.as_str())
    }
}

impl<S: FlagSet> Args for KeyFlags<S> {
    fn augment_args(command: Command) -> Command {
        let help = |key: &Key| S::HELP.iter().find(|(flag, _)| *flag == key.flag).map(|(_, help)| *help);
        let arg = |key| help(key).map_or(arg(key), |help| arg(key).help(help));
        command.args(S::FLAGS.iter().filter_map(|flag| Key::of_flag(flag)).map(arg))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<S: FlagSet> FromArgMatches for KeyFlags<S> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let given = S::FLAGS.iter().filter_map(|flag| Some((*flag, matches.get_one::<Given>(flag)?.clone())));
        Ok(Self { given: given.collect(), set: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

fn arg(key: &'static Key) -> Arg {
    let arg = Arg::new(key.flag)
        .long(key.flag)
        .value_name(key.value)
        .help(key.help.trim_end_matches('.'))
        .allow_negative_numbers(matches!(key.kind, Kind::Whole | Kind::Real))
        .value_parser(parser(key));
    if key.flag == "output" { arg.short('o') } else { arg }
}

/// Checks a value before any file is opened.
fn parser(key: &'static Key) -> ValueParser {
    let given = move |value: &str| match key.line(value) {
        Ok(line) => Ok(Given { value: value.to_owned(), line }),
        Err(e) => Err(format!("{}; {}", e.problem, e.help)),
    };
    match key.kind {
        Kind::Name(names) => {
            let names = names.iter().map(|(name, help)| PossibleValue::new(*name).help(*help));
            PossibleValuesParser::new(names).try_map(move |name| given(&name)).into()
        }
        _ => ValueParser::new(given),
    }
}
