//! Findings of the compilation of a scene: repairs and hazards.

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// For information; the image is correct.
    Note,
    /// The image may differ from the intended one.
    Hazard,
}

/// One finding and its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The severity.
    pub severity: Severity,
    /// The object of the finding: `mesh "lid"`.
    pub place: String,
    /// The defect and the repair or the help.
    pub message: String,
}

/// All findings of a compilation.
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

    /// Findings that can change the image.
    pub fn hazards(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.severity == Severity::Hazard)
    }
}
