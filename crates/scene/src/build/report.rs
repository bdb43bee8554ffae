//! What building a scene found: repairs made, hazards left.

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Good to know; the image is right.
    Note,
    /// The image may not be what was meant.
    Hazard,
}

/// One finding, with the place it concerns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// How much it matters.
    pub severity: Severity,
    /// What it concerns: `mesh "lid"`.
    pub place: String,
    /// What was found and done.
    pub message: String,
}

/// Everything building found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BuildReport {
    /// Findings in the order of the scene's meshes.
    pub findings: Vec<Finding>,
}

impl BuildReport {
    pub(crate) fn note(&mut self, place: impl Into<String>, message: impl Into<String>) {
        self.push(Severity::Note, place, message);
    }

    pub(crate) fn hazard(&mut self, place: impl Into<String>, message: impl Into<String>) {
        self.push(Severity::Hazard, place, message);
    }

    fn push(&mut self, severity: Severity, place: impl Into<String>, message: impl Into<String>) {
        self.findings.push(Finding { severity, place: place.into(), message: message.into() });
    }

    /// The findings that may change the image.
    pub fn hazards(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Hazard)
    }
}
