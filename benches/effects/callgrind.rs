//! Instructions per sample, as callgrind counts them: the same number on an idle machine and on a busy one.

use std::path::Path;
use std::process::{Command, Stdio};

/// The result of one run of the measured program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    /// Instructions from start to end.
    pub(crate) instructions: u64,
    /// The output of the program: a fingerprint of the image.
    pub(crate) image: String,
}

/// Price of one sample, and the image that it belongs to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Price {
    /// Instructions per sample.
    pub(crate) instructions: f64,
    /// Fingerprint of the image of all samples.
    pub(crate) image: String,
}

/// Fails with help where valgrind cannot be started.
pub(crate) fn require_valgrind() -> Result<(), String> {
    match Command::new("valgrind").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("valgrind does not run ({status}); help: install it anew")),
        Err(e) => Err(format!(
            "valgrind cannot be started ({e}), and without it instructions cannot be counted; help: install it, as in \
             `apt-get install valgrind`"
        )),
    }
}

/// Runs a program under callgrind, with its arguments.
pub(crate) fn run(program: &Path, arguments: &[&str]) -> Result<Run, String> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(program)
        .args(arguments)
        .output()
        .map_err(|e| format!("valgrind cannot be started: {e}"))?;
    let (said, report) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if !output.status.success() {
        return Err(format!("{} {} failed under valgrind:\n{report}", program.display(), arguments.join(" ")));
    }
    let instructions = collected(&report).ok_or_else(|| format!("callgrind reports no instructions:\n{report}"))?;
    Ok(Run { instructions, image: said.trim().to_owned() })
}

/// The number in the line `==PID== Collected : NUMBER` of a report.
pub(crate) fn collected(report: &str) -> Option<u64> {
    report.lines().find_map(|line| line.split_once("Collected :")?.1.trim().parse().ok())
}

/// What a sample costs, from a run with `samples` of them and one with twice as many: what both do once cancels.
pub(crate) fn price(single: &Run, double: &Run, samples: u32) -> Result<Price, String> {
    let more = double.instructions.checked_sub(single.instructions).filter(|n| *n > 0 && samples > 0);
    let more = more.ok_or_else(|| {
        format!("twice the samples take {} instructions after {}", double.instructions, single.instructions)
    })?;
    Ok(Price { instructions: more as f64 / f64::from(samples), image: double.image.clone() })
}
