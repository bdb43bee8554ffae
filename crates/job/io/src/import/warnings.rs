//! Collects warnings. Equal ones are stored once, and a file with thousands of faults gives a readable list.

use crate::error::ImportWarning;
use std::fmt::Display;
use std::path::Path;

/// The warnings about one file, in the order of their detection.
#[derive(Debug)]
pub(crate) struct Warnings {
    file: String,
    list: Vec<ImportWarning>,
    omitted: usize,
}

impl Warnings {
    /// Maximum number of warnings.
    const MOST: usize = 200;

    /// A list for the faults of `path`.
    pub(crate) fn new(path: &Path) -> Self {
        let file = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Self { file, list: Vec::new(), omitted: 0 }
    }

    /// Records a fault at `place` and its repair.
    pub(crate) fn push(&mut self, place: impl Display, message: impl Into<String>) {
        let warning = ImportWarning { place: format!("{}: {place}", self.file), message: message.into() };
        if self.list.contains(&warning) {
        } else if self.list.len() < Self::MOST {
            self.list.push(warning);
        } else {
            self.omitted += 1;
        }
    }

    /// All of them, in order.
    pub(crate) fn finish(mut self) -> Vec<ImportWarning> {
        if self.omitted > 0 {
            let message = format!("{} further warnings are not listed", self.omitted);
            self.list.push(ImportWarning { place: self.file, message });
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_are_kept_once_and_their_number_is_bounded() {
        let mut warnings = Warnings::new(Path::new("folder/lid.obj"));
        for line in 0..Warnings::MOST + 3 {
            warnings.push(format!("line {line}"), "a face of two corners is left out");
            warnings.push("line 0", "a face of two corners is left out");
        }
        let list = warnings.finish();
        assert_eq!(list.len(), Warnings::MOST + 1);
        assert_eq!(list[0].to_string(), "lid.obj: line 0: a face of two corners is left out");
        assert_eq!(list[Warnings::MOST].to_string(), "lid.obj: 3 further warnings are not listed");
    }
}
