//! The cost of effects in instructions per sample on a plain scene: where none is used, and each where it is used. Needs
//! valgrind.
//!
//! `cargo bench -p dunkelfeld-integrator --bench effects -- [--markdown FILE] [--samples N] [--only NAME]...`
//!
//! - `--markdown FILE` rewrites the tables of a page; paths are relative to the root of the repository.
//! - `--samples N` takes N and then 2 N samples in each of 256 pixels (default 32).
//! - `--only NAME` measures the plain scene and the named effects only.
//!
//! Ends with 1 if more than 2 % of the instructions are for effects that the plain scene does not use. Without `--bench`
//! (`cargo test --bench effects`) every case renders a few samples, and nothing is counted.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench prints its results")]

#[path = "effects/callgrind.rs"]
mod callgrind;
#[path = "effects/scene.rs"]
mod scene;
#[path = "effects/table.rs"]
mod table;
#[path = "effects/unused.rs"]
mod unused;

use callgrind::Price;
use dunkelfeld_integrator::{Estimator, LearnedRoulette, PixelSample};
use dunkelfeld_scene::Effect;
use scene::Case;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use table::Row;

/// Side of the film, and of the grid of pixels on it that are rendered.
const FILM: u32 = 64;
const PIXELS: u32 = 16;

/// Limit of the instructions for effects that a scene does not use \[%\].
const BAR: f64 = 2.0;

/// The arguments of the benchmark.
struct Options {
    samples: u32,
    markdown: Option<PathBuf>,
    only: Vec<String>,
    /// As its own child, under callgrind: the case to render.
    render: Option<String>,
    bench: bool,
}

fn main() -> ExitCode {
    let outcome = options(std::env::args().skip(1)).and_then(|options| match &options.render {
        Some(name) => render(name, options.samples).map(|image| {
            println!("{image}");
            true
        }),
        None if options.bench => measure(&options),
        None => Case::all().iter().try_for_each(|case| render(&case.name(), 1).map(drop)).map(|()| true),
    });
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(problem) => {
            eprintln!("error: {problem}");
            ExitCode::from(2)
        }
    }
}

fn options(arguments: impl Iterator<Item = String>) -> Result<Options, String> {
    let mut options = Options { samples: 32, markdown: None, only: Vec::new(), render: None, bench: false };
    let mut arguments = arguments;
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{argument} needs a value"));
        match argument.as_str() {
            "--bench" => options.bench = true,
            "--markdown" => options.markdown = Some(root().join(value()?)),
            "--only" => options.only.push(value()?),
            "--render" => options.render = Some(value()?),
            "--samples" => {
                let text = value()?;
                let samples = text.parse().ok().filter(|n| (1..=1 << 16).contains(n));
                options.samples = samples.ok_or(format!("--samples {text}: write a whole number from 1 to 65536"))?;
            }
            other => return Err(format!("unknown option {other}; the first lines of benches/effects.rs list all")),
        }
    }
    let names: Vec<String> = Case::all().into_iter().map(Case::name).collect();
    match options.only.iter().find(|name| !names.contains(name)) {
        Some(unknown) => Err(format!("--only {unknown}: write one of {}", names.join(", "))),
        None => Ok(options),
    }
}

/// The root of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

/// Renders a case in this process, on this thread. The returned value differs for two images that differ in a bit.
fn render(name: &str, samples: u32) -> Result<String, String> {
    let case = Case::all().into_iter().find(|case| case.name() == name).ok_or(format!("there is no case {name}"))?;
    let scene = case.scene()?;
    let camera = scene.ray_generator(&scene.cameras()[0], FILM, FILM).map_err(|e| e.to_string())?;
    let roulette = (case == Case::Effect(Effect::LearnedRoulette)).then(|| {
        LearnedRoulette::train(&scene, &camera, [FILM; 2], 8192, |batches, trace| batches.map(trace).collect())
    });
    let roulette = roulette.flatten();
    let roulette = roulette.as_ref();
    let estimator = Estimator { scene: &scene, camera: &camera, width: FILM, seed: 1, frame: 0, roulette };
    let (mut fingerprint, mut sum) = (0xcbf2_9ce4_8422_2325u64, 0.0);
    let pixels = (0..PIXELS * PIXELS).map(|pixel| [pixel % PIXELS, pixel / PIXELS].map(|k| k * (FILM / PIXELS)));
    let at: Vec<_> = pixels.flat_map(|[x, y]| (0..samples).map(move |index| PixelSample { x, y, index })).collect();
    for channel in estimator.samples(&at).iter().flat_map(|sample| sample.radiance.to_array()) {
        // Fowler, Noll and Vo's hash (1a), a word at a time.
        fingerprint = (fingerprint ^ u64::from(channel.to_bits())).wrapping_mul(0x0100_0000_01b3);
        sum += f64::from(channel);
    }
    let mean = sum / f64::from(3 * PIXELS * PIXELS * samples);
    if !(mean > 0.0 && mean.is_finite()) {
        return Err(format!("the mean radiance of {name} is {mean}"));
    }
    Ok(format!("{fingerprint:016x} {mean:.6}"))
}

/// Measures all cases and prints what they cost. False if the limit is exceeded.
fn measure(options: &Options) -> Result<bool, String> {
    callgrind::require_valgrind()?;
    let own = std::env::current_exe().map_err(|e| format!("the bench does not find itself: {e}"))?;
    let plain = price(&own, Case::Plain, options.samples)?;
    let (verdict, is_met) = verdict(&plain)?;
    println!("{verdict}\n");
    let mut effects = Vec::new();
    for case in Case::all() {
        let name = case.name();
        if matches!(case, Case::Plain | Case::Without(_)) || !(options.only.is_empty() || options.only.contains(&name))
        {
            continue;
        }
        let found = price(&own, case, options.samples)?;
        let without = match case {
            Case::Effect(effect) if effect.is_technique() => Some(price(&own, Case::Without(effect), options.samples)?),
            _ => None,
        };
        let against = without.as_ref().unwrap_or(&plain);
        let row = Row {
            instructions: found.instructions,
            against: against.instructions,
            same_image: found.image == against.image,
            name,
        };
        eprintln!("{}: {:+.2} %", row.name, row.percent());
        effects.push(row);
    }
    let tables = format!("{verdict}\n\n{}", table::markdown(&effects));
    println!("{tables}");
    if let Some(path) = &options.markdown {
        if effects.len() < Effect::ALL.len() {
            return Err("--markdown with --only would write half a table; leave one of them out".into());
        }
        let page = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let page = table::replaced(&page, &tables).map_err(|e| format!("{}: {e}", path.display()))?;
        std::fs::write(path, page).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("wrote {}", path.display());
    }
    Ok(is_met)
}

/// The instructions of the plain scene for effects that it does not use, in words, and whether they are within the limit.
fn verdict(plain: &Price) -> Result<(String, bool), String> {
    let [shared, effects, tests, other] = unused::sums(&plain.lines, |file| std::fs::read_to_string(file).ok());
    let percent = |cost: f64| 100.0 * cost / plain.instructions;
    let total = percent(effects + tests);
    if shared + effects + tests < 0.1 * plain.instructions {
        return Err("the program has no line tables; help: keep `debug` in the profile of the bench".into());
    }
    let verdict = format!(
        "A sample of the plain scene takes {:.0} instructions. Code for effects that it does not use takes {:.2} % of them, \
         and lines of other code that test for such effects take {:.2} %: together {total:.2} %, where at most {BAR} % are \
         allowed. {:.0} % are in libraries, most of them inlined.",
        plain.instructions,
        percent(effects),
        percent(tests),
        percent(other),
    );
    Ok((verdict, total <= BAR))
}

/// The cost of a sample of a case in a program.
fn price(program: &Path, case: Case, samples: u32) -> Result<Price, String> {
    let run = |samples: u32| callgrind::run(program, &["--render", &case.name(), "--samples", &samples.to_string()]);
    callgrind::price(&run(samples)?, &run(2 * samples)?, PIXELS * PIXELS * samples)
}
