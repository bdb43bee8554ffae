//! Instructions per sample, as callgrind counts them: the same number on an idle machine and on a busy one.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

/// Instructions by file and line of the source. Code that is inlined belongs to its own lines.
pub(crate) type Lines<N> = BTreeMap<(String, u32), N>;

/// The result of one run of the measured program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    /// Instructions from start to end.
    pub(crate) lines: Lines<u64>,
    /// The output of the program: a fingerprint of the image.
    pub(crate) image: String,
}

/// Price of one sample, and the image that it belongs to.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Price {
    /// Instructions per sample.
    pub(crate) instructions: f64,
    /// The same by line.
    pub(crate) lines: Lines<f64>,
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
    let profile = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("callgrind.{}", std::process::id()));
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--compress-strings=no", "--compress-pos=no"])
        .arg(format!("--callgrind-out-file={}", profile.display()))
        .arg(program)
        .args(arguments)
        // Callgrind would count each byte of a `rep stosb` or `rep movsb`.
        .env(
            "GLIBC_TUNABLES",
            "glibc.cpu.x86_rep_stosb_threshold=1073741824:glibc.cpu.x86_rep_movsb_threshold=1073741824",
        )
        .output()
        .map_err(|e| format!("valgrind cannot be started: {e}"))?;
    let (said, report) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if !output.status.success() {
        return Err(format!("{} {} failed under valgrind:\n{report}", program.display(), arguments.join(" ")));
    }
    let text = std::fs::read(&profile).map_err(|e| format!("{}: {e}", profile.display()))?;
    std::fs::remove_file(&profile).map_err(|e| format!("{}: {e}", profile.display()))?;
    Ok(Run { lines: lines(&String::from_utf8_lossy(&text)), image: said.trim().to_owned() })
}

/// The instructions in a profile of callgrind, by line. Names and positions are not compressed. The cost after `calls=` is
/// that of the called function, whose own lines contain it.
pub(crate) fn lines(profile: &str) -> Lines<u64> {
    let (mut found, mut file, mut is_call) = (Lines::new(), "", false);
    for line in profile.lines() {
        if let Some((key, value)) = line.split_once('=') {
            match key {
                "fl" | "fi" | "fe" => file = value,
                "calls" => is_call = true,
                _ => {}
            }
        } else if !std::mem::take(&mut is_call)
            && let Some((at, cost)) = line.split_once(' ')
            && let (Ok(at), Ok(cost)) = (at.parse(), cost.parse::<u64>())
        {
            *found.entry((file.to_owned(), at)).or_default() += cost;
        }
    }
    found
}

/// What a sample costs, from a run with `samples` of them and one with twice as many: what both do once cancels.
pub(crate) fn price(single: &Run, double: &Run, samples: u32) -> Result<Price, String> {
    let mut lines: Lines<f64> = Lines::new();
    for (run, sign) in [(single, -1.0), (double, 1.0)] {
        for (line, cost) in &run.lines {
            *lines.entry(line.clone()).or_default() += sign * *cost as f64 / f64::from(samples);
        }
    }
    let instructions: f64 = lines.values().sum();
    if !(instructions > 0.0 && instructions.is_finite()) {
        return Err(format!("twice the samples take {instructions} more instructions per sample"));
    }
    Ok(Price { instructions, lines, image: double.image.clone() })
}
