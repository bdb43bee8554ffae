//! Renders a scene many times from one load, and prints the time of each round: the cost of a call from Rust, for a comparison
//! with Python and C++ (`benches/linking/`).
//!
//!     cargo run --release --example renders -- scenes/inspection/inspection.toml 100 64 4

#![allow(clippy::print_stdout, reason = "an example prints its result")]

use dunkelfeld::{Cancel, Error, Project, RenderOptions, Silent};
use std::time::Instant;

fn main() -> Result<(), Error> {
    let usage = || Error::setting("arguments", "four are needed", "write SCENE RENDERS SIDE SPP");
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, renders, side, spp] = arguments.as_slice() else { return Err(usage()) };
    let number = |text: &str| text.parse::<u32>().map_err(|_| usage());
    let (renders, side, spp) = (number(renders)?, number(side)?, number(spp)?);
    let mut project = Project::open(scene)?;
    for round in 1..=3 {
        let began = Instant::now();
        let mut sum = 0.0;
        for seed in 0..renders {
            let keys = format!("film = {{ width = {side}, height = {side} }}\nbudget.spp = {spp}\nseed = {seed}");
            let options = RenderOptions::default().with_keys(keys);
            let result = project.render_options(options, &Silent, &Cancel::new())?;
            sum += f64::from(result.rendering.film.sums.mean().at(0, 0)[0]);
        }
        println!("round {round}: {:.4} s, sum {sum:.6}", began.elapsed().as_secs_f64());
    }
    Ok(())
}
