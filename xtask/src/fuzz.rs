//! Builds the fuzz targets with the stable compiler, runs them for a while, and reports the findings.

use std::collections::VecDeque;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::thread;

/// Coverage for libFuzzer, by flags that the stable compiler takes; `cargo fuzz` sets about the same.
const COVERAGE: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares";
/// Flags that find faults of unsafe code; the stable compiler takes them with `RUSTC_BOOTSTRAP`.
const ADDRESS_SANITIZER: &str = " -Zsanitizer=address";
/// Memory of a process \[MiB\]; the targets bound their heap to less.
const MAX_MEMORY: u32 = 2048;
/// Seconds of wall-clock time that one input may take. Most inputs take milliseconds, so that only a loop without an end
/// takes as long, on a busy machine too.
const MAX_SECONDS: u32 = 60;
/// Larger files of a corpus of scenes are no seeds \[bytes\].
const LARGEST_SEED: u64 = 32 << 10;
/// The variable that names a folder with files of other programs, as for the tests.
const CORPUS_VARIABLE: &str = "DUNKELFELD_CORPUS";

/// Settings of the runs.
#[derive(Debug, PartialEq, Eq)]
struct Plan {
    /// Targets, all of them if none is named.
    targets: Vec<String>,
    seconds: u32,
    jobs: usize,
    address_sanitizer: bool,
    /// Reduce the corpora to the inputs that add coverage, instead of a search for more.
    minimise: bool,
}

/// `cargo xtask fuzz [TARGET...] [--seconds N] [--jobs N] [--asan] [--minimise]`.
///
/// # Errors
/// A finding, a target that does not exist or cannot be built, arguments out of range.
pub(crate) fn run(arguments: &[&str]) -> Result<(), String> {
    let plan = parse(arguments)?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("xtask has no parent folder")?;
    let fuzz = root.join("fuzz");
    let all = targets(&fuzz)?;
    if let Some(unknown) = plan.targets.iter().find(|t| !all.contains(t)) {
        return Err(format!("there is no target `{unknown}`; the targets are {}", all.join(", ")));
    }
    let chosen = if plan.targets.is_empty() { all } else { plan.targets.clone() };
    let home = fuzz.join("target").join(if plan.address_sanitizer { "asan" } else { "stable" });
    let binaries = build(&fuzz, &home, plan.address_sanitizer)?;

    let queue = Mutex::new(chosen.iter().cloned().collect::<VecDeque<_>>());
    let reports = Mutex::new(Vec::new());
    println!("{}", Report::HEAD);
    thread::scope(|scope| {
        for _ in 0..plan.jobs {
            scope.spawn(|| {
                while let Some(target) = queue.lock().ok().and_then(|mut q| q.pop_front()) {
                    let place = Place { fuzz: &fuzz, home: &home, binary: binaries.join(&target), target: &target };
                    let report = if plan.minimise { place.minimise() } else { place.run(plan.seconds) };
                    match &report {
                        Ok(report) => println!("{}", report.line()),
                        Err(e) => eprintln!("{target}: {e}"),
                    }
                    if let Ok(mut reports) = reports.lock() {
                        reports.push(report);
                    }
                }
            });
        }
    });
    let reports = reports.into_inner().map_err(|_| "a run panicked")?;
    let findings = reports.iter().filter(|r| r.as_ref().map_or(true, |r| r.finding.is_some())).count();
    if findings > 0 {
        return Err(format!("{findings} of {} targets found something", reports.len()));
    }
    Ok(())
}

fn parse(arguments: &[&str]) -> Result<Plan, String> {
    let mut plan = Plan { targets: Vec::new(), seconds: 60, jobs: 2, address_sanitizer: false, minimise: false };
    let mut rest = arguments.iter();
    while let Some(&argument) = rest.next() {
        let mut number = || {
            let value = rest.next().and_then(|v| v.parse::<u32>().ok()).filter(|v| *v > 0);
            value.ok_or_else(|| format!("{argument} takes a whole number from 1"))
        };
        match argument {
            "--seconds" => plan.seconds = number()?,
            "--jobs" => plan.jobs = number()? as usize,
            "--asan" => plan.address_sanitizer = true,
            "--minimise" => plan.minimise = true,
            flag if flag.starts_with('-') => return Err(format!("there is no option {flag}")),
            target => plan.targets.push(target.into()),
        }
    }
    Ok(plan)
}

/// The targets, by the files of their folder.
fn targets(fuzz: &Path) -> Result<Vec<String>, String> {
    let folder = fuzz.join("fuzz_targets");
    let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension() == Some(OsStr::new("rs")))
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    Ok(names)
}

/// Builds all targets; gives the folder of the programs.
fn build(fuzz: &Path, home: &Path, address_sanitizer: bool) -> Result<PathBuf, String> {
    let host = host()?;
    let mut flags = COVERAGE.to_owned();
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    if address_sanitizer {
        flags.push_str(ADDRESS_SANITIZER);
        cargo.env("RUSTC_BOOTSTRAP", "1");
    }
    // With a target triple the flags are not those of build scripts and of macros.
    cargo.args(["build", "--release", "--bins", "--target", &host]);
    cargo.arg("--target-dir").arg(home).arg("--manifest-path").arg(fuzz.join("Cargo.toml"));
    cargo.env("RUSTFLAGS", flags).env_remove("CARGO_ENCODED_RUSTFLAGS");
    let status = cargo.status().map_err(|e| format!("cargo cannot be started: {e}"))?;
    if !status.success() {
        return Err("the targets cannot be built, see above; libFuzzer needs a C++ compiler, such as g++".into());
    }
    Ok(home.join(host).join("release"))
}

fn host() -> Result<String, String> {
    let output = Command::new("rustc").arg("-vV").output().map_err(|e| format!("rustc cannot be started: {e}"))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let host = text.lines().find_map(|line| line.strip_prefix("host: "));
    host.map(str::to_owned).ok_or_else(|| "rustc names no host".into())
}

/// One target and its folders.
struct Place<'a> {
    fuzz: &'a Path,
    home: &'a Path,
    binary: PathBuf,
    target: &'a str,
}

impl Place<'_> {
    /// Corpus files in the repository.
    fn seeds(&self) -> PathBuf {
        self.fuzz.join("corpus").join(self.target)
    }

    /// Corpus of earlier runs on this machine. Each run continues with it.
    fn found(&self) -> PathBuf {
        self.fuzz.join("target/found").join(self.target)
    }

    fn run(&self, seconds: u32) -> Result<Report, String> {
        let findings = self.fuzz.join("target/findings").join(self.target);
        for folder in [&self.seeds(), &self.found(), &findings] {
            fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        }
        self.borrow_seeds();
        let mut command = Command::new(&self.binary);
        command.arg(self.found()).arg(self.seeds());
        command.arg(format!("-artifact_prefix={}/", findings.display()));
        command.arg(format!("-max_total_time={seconds}"));
        let dictionary = self.fuzz.join("dictionaries").join(format!("{}.dict", self.target));
        if dictionary.is_file() {
            command.arg(format!("-dict={}", dictionary.display()));
        }
        let (log, success) = self.execute(command)?;
        let mut report = Report::read(self.target, &log);
        let slow = log.lines().rev().find_map(|line| Some(line.split_once("Slowest unit: ")?.1.to_owned()));
        if !success || slow.is_some() {
            report.finding = Some(self.explain(&log));
        }
        Ok(report)
    }

    /// Replaces what is in the repository by as few and small inputs of it and of earlier runs as have all their coverage.
    fn minimise(&self) -> Result<Report, String> {
        let fault = |e: std::io::Error| format!("the corpus of {}: {e}", self.target);
        let fresh = self.fuzz.join("target/minimised").join(self.target);
        let _ = fs::remove_dir_all(&fresh);
        fs::create_dir_all(&fresh).map_err(fault)?;
        for folder in [self.seeds(), self.found()] {
            fs::create_dir_all(folder).map_err(fault)?;
        }
        let mut command = Command::new(&self.binary);
        command.arg("-merge=1").arg(&fresh).arg(self.seeds()).arg(self.found());
        let (log, success) = self.execute(command)?;
        if !success {
            return Err(format!("the corpus cannot be minimised:\n{}", last_lines(&log, 20)));
        }
        let _ = fs::remove_dir_all(self.found());
        fs::rename(&fresh, self.found()).map_err(fault)?;
        Ok(Report::read(self.target, &log))
    }

    /// Runs the program with the bounds of all runs; gives its messages and whether it ended well.
    fn execute(&self, mut command: Command) -> Result<(String, bool), String> {
        let logs = self.home.join("logs");
        let path = logs.join(format!("{}.log", self.target));
        let fault = |e: std::io::Error| format!("{}: {e}", path.display());
        fs::create_dir_all(&logs).map_err(fault)?;
        command.arg(format!("-rss_limit_mb={MAX_MEMORY}")).arg(format!("-timeout={MAX_SECONDS}"));
        command.arg(format!("-report_slow_units={MAX_SECONDS}"));
        command.arg("-print_final_stats=1").env("RUST_BACKTRACE", "1");
        // Leaks are no faults of a reader that keeps tables; decoders' thread pools end later than the run.
        command.env("ASAN_OPTIONS", "detect_leaks=0:allocator_may_return_null=1");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(&path).map_err(fault)?);
        let status = command.status().map_err(|e| format!("{} cannot be started: {e}", self.binary.display()))?;
        let log = fs::read(&path).map_err(fault)?;
        Ok((String::from_utf8_lossy(&log).into_owned(), status.success()))
    }

    /// Files of other programs, if their folder is named, become seeds of the targets that read such files.
    fn borrow_seeds(&self) {
        let extensions: &[&str] = match self.target {
            "gltf" => &["gltf", "glb"],
            "obj" => &["obj"],
            "stl" => &["stl"],
            "ply" => &["ply"],
            "images" | "gray" => &["png", "jpg", "tif", "bmp"],
            _ => return,
        };
        let Some(folder) = std::env::var_os(CORPUS_VARIABLE) else { return };
        let mut folders = vec![PathBuf::from(folder)];
        let mut number = 0;
        while let Some(folder) = folders.pop() {
            let Ok(entries) = fs::read_dir(folder) else { continue };
            for path in entries.filter_map(|e| Some(e.ok()?.path())) {
                let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
                if path.is_dir() {
                    folders.push(path);
                } else if extensions.contains(&extension.as_str())
                    && path.metadata().is_ok_and(|m| m.len() <= LARGEST_SEED)
                    && let Ok(mut bytes) = fs::read(&path)
                {
                    if self.target == "images" {
                        bytes.insert(0, 0);
                    }
                    number += 1;
                    let _ = fs::write(self.found().join(format!("borrowed-{number}")), bytes);
                }
            }
        }
    }

    /// The end of the messages, and the command that replays it.
    fn explain(&self, log: &str) -> String {
        let file = log.lines().rev().find_map(|line| line.split_once("Test unit written to ").map(|(_, file)| file));
        let replay = match file {
            Some(file) => format!("replay it with:\n  RUST_BACKTRACE=1 {} {file}", self.binary.display()),
            None => "no input was written".into(),
        };
        let start = log.find("panicked at").or_else(|| log.find("ERROR: ")).unwrap_or(log.len().saturating_sub(2000));
        let start = log[..start].rfind('\n').map_or(0, |i| i + 1);
        let lines: Vec<&str> = log[start..].lines().take(40).collect();
        format!("{}\n{replay}", lines.join("\n"))
    }
}

fn last_lines(text: &str, n: usize) -> String {
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(n)..].join("\n")
}

/// The result of a run.
#[derive(Debug, Default, PartialEq, Eq)]
struct Report {
    target: String,
    executions: u64,
    per_second: u64,
    coverage: u64,
    features: u64,
    slowest: u64,
    memory: u64,
    finding: Option<String>,
}

impl Report {
    const HEAD: &str = "target            executions   per s  edges  features  slowest  memory";

    fn read(target: &str, log: &str) -> Self {
        let statistic = |name: &str| {
            let line = log.lines().rev().find_map(|line| line.strip_prefix("stat::")?.strip_prefix(name));
            line.and_then(|rest| rest.trim_start_matches(':').trim().parse().ok()).unwrap_or(0)
        };
        // Progress lines are like `#2048 NEW cov: 931 ft: 2212 corp: ...`.
        let progress = |name: &str| {
            let words = log.lines().rev().filter(|line| line.starts_with('#'));
            let value = |line: &str| line.split_once(name)?.1.split_whitespace().next()?.parse().ok();
            words.filter_map(value).next().unwrap_or(0)
        };
        Self {
            target: target.into(),
            executions: statistic("number_of_executed_units"),
            per_second: statistic("average_exec_per_sec"),
            coverage: progress(" cov: "),
            features: progress(" ft: "),
            slowest: statistic("slowest_unit_time_sec"),
            memory: statistic("peak_rss_mb"),
            finding: None,
        }
    }

    fn line(&self) -> String {
        let Self { target, executions, per_second, coverage, features, slowest, memory, finding } = self;
        let line = format!(
            "{target:<16} {executions:>11} {per_second:>7} {coverage:>6} {features:>9} {slowest:>6} s {memory:>3} MiB"
        );
        finding.as_ref().map_or(line.clone(), |finding| format!("{line}\n\nFOUND by {target}:\n{finding}\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_target_is_in_the_manifest() {
        let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz");
        let manifest = fs::read_to_string(fuzz.join("Cargo.toml")).expect("the manifest");
        for target in targets(&fuzz).expect("the folder") {
            assert!(manifest.contains(&format!("path = \"fuzz_targets/{target}.rs\"")), "{target}");
        }
    }
}
