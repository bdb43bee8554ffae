//! Refusals and errors, as the page shows them.

use dunkelfeld::Error;
use dunkelfeld::io::visible_line;
use serde::Serialize;
use std::borrow::Cow;

/// A refusal: the answer of a request that cannot be met.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Fault {
    pub(crate) problem: String,
    pub(crate) place: Option<String>,
    pub(crate) help: Option<String>,
    /// Is there no picture yet? The same request is answered later.
    #[serde(skip)]
    pub(crate) is_early: bool,
}

impl Fault {
    pub(crate) fn new(problem: impl Into<String>, help: impl Into<String>) -> Self {
        Self { problem: problem.into(), place: None, help: Some(help.into()), is_early: false }
    }

    /// A request about a picture before the first one.
    pub(crate) fn no_picture() -> Self {
        Self { is_early: true, ..Self::new("there is no picture yet", "wait for the first one") }
    }

    /// A request about the scene of the picture, which the thread that renders no longer has.
    pub(crate) fn earlier_scene() -> Self {
        Self::new("the picture is that of the scene before its change", "wait for the next picture")
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        write!(f, "{}", self.problem)?;
        match &self.help {
            Some(help) => write!(f, "\n  help: {help}"),
            None => Ok(()),
        }
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        let parts = error.parts();
        let Some(file) = parts.file else {
            // That of too little memory has the account.
            let (problem, help) = (error.statement(), error.help().map(Cow::into_owned));
            return Self { problem, place: None, help, is_early: false };
        };
        let caret = error.caret();
        let line = caret.lines().find_map(|line| {
            let (number, text) = line.split_once('|')?;
            Some(format!("line {}: {}", number.trim().parse::<u32>().ok()?, text.trim()))
        });
        let of_file = [Some(file.to_string_lossy()), parts.place].into_iter().flatten();
        let places: Vec<String> = of_file.map(|place| visible_line(&place).into_owned()).chain(line).collect();
        Self {
            problem: parts.problem.map_or_else(|| error.to_string(), |problem| visible_line(&problem).into_owned()),
            place: Some(places.join(", ")),
            help: parts.help.map(|help| visible_line(&help).into_owned()).filter(|help| !help.is_empty()),
            is_early: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld::Project;

    /// The place names file, key and line.
    #[test]
    fn the_place_of_an_error_has_its_line() {
        let job = "scene = 'none'\n[camera]\nlook_at = [0, 0, 0]\nworking_distanse = 1\n";
        let fault = Fault::from(Project::from_text("a.toml", job).expect_err("a misspelt key"));
        let place = fault.place.as_deref().expect("a place");
        assert!(place.starts_with("a.toml, ") && place.ends_with("line 4: working_distanse = 1"), "{place}");
        assert!(fault.problem.contains("unknown key") && !fault.problem.contains("a.toml"), "{}", fault.problem);
        assert!(fault.help.as_deref().is_some_and(|help| help.contains("working_distance")), "{:?}", fault.help);
        let text = fault.to_string();
        assert!(text.starts_with("a.toml, ") && text.contains("\n  help: "), "{text}");
    }
}
