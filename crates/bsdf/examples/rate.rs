//! Time of scattering functions per lane \[ns\]: a view with one or with four evaluations, and a view with a sample.
//!
//! `cargo run --release -p dunkelfeld-bsdf --example rate`

#![allow(clippy::print_stdout)]

use dunkelfeld_bsdf::{Bsdf, InLanes, Principled, PrincipledParams, View};
use dunkelfeld_geometry::{LocalDir, Vec3};
use dunkelfeld_lanes::{InstructionSet, Lanes, V3, dispatch};
use dunkelfeld_sampling::{Sampler, warp};
use std::hint::black_box;
use std::time::Instant;

const COUNT: usize = 1024;
type Vectors = [[f32; COUNT]; 3];

struct Inputs {
    wo: Vectors,
    wi: [Vectors; 4],
    /// Direction (2), lobe.
    u: Vectors,
}

/// The least time of many runs, for each of the inputs.
fn time(mut run: impl FnMut() -> f32) -> f64 {
    let mut once = || {
        let start = Instant::now();
        black_box(run());
        start.elapsed().as_secs_f64() * 1e9 / COUNT as f64
    };
    (0..1000).map(|_| once()).fold(f64::INFINITY, f64::min)
}

#[inline(always)]
fn at<F: Lanes>(token: F::Token, v: &Vectors, k: usize) -> V3<F> {
    V3::new(F::load(token, &v[0][k..]), F::load(token, &v[1][k..]), F::load(token, &v[2][k..]))
}

#[inline(always)]
fn eval<F: Lanes, const RICH: bool>(token: F::Token, surface: &Principled, i: &Inputs, count: usize) -> f32 {
    let mut sum = F::splat(token, 0.0);
    for k in (0..COUNT).step_by(F::WIDTH) {
        let surface = InLanes::<F>::splat(token, black_box(surface));
        let view = surface.view::<RICH>(at::<F>(token, &i.wo, k));
        for wi in &i.wi[..count] {
            let (value, pdf) = view.eval_pdf(at::<F>(token, wi, k));
            sum += value.r + value.g + value.b + pdf;
        }
    }
    sum.to_array()[0]
}

#[inline(always)]
fn sample<F: Lanes, const RICH: bool>(token: F::Token, surface: &Principled, i: &Inputs) -> f32 {
    let mut sum = F::splat(token, 0.0);
    for k in (0..COUNT).step_by(F::WIDTH) {
        let surface = InLanes::<F>::splat(token, black_box(surface));
        let u = at::<F>(token, &i.u, k);
        let s = surface.view::<RICH>(at::<F>(token, &i.wo, k)).sample(u.z, [u.x, u.y]);
        sum += s.weight.r + s.weight.g + s.weight.b + s.pdf + s.wi.x;
    }
    sum.to_array()[0]
}

fn rates<const RICH: bool>(name: &str, params: PrincipledParams, i: &Inputs) {
    let surface = Principled::new(&params);
    let show = |what: &str, times: [f64; 3]| {
        println!("{name:12} {what:8}{}", times.map(|t| format!("{t:9.2}")).concat());
    };
    let bsdf = black_box(Bsdf::Principled(surface));
    let local = |v: &Vectors, k: usize| LocalDir(Vec3::new(v[0][k], v[1][k], v[2][k]));
    let eval_one = |count: usize| -> f32 {
        let of = |k: usize, wi: &Vectors| bsdf.eval_pdf(local(&i.wo, k), local(wi, k));
        let sum =
            |k: usize| -> f32 { i.wi[..count].iter().map(|wi| of(k, wi)).map(|(c, p)| c.r + c.g + c.b + p).sum() };
        (0..COUNT).map(sum).sum()
    };
    let sample_one = || -> f32 {
        let of = |k: usize| bsdf.sample(local(&i.wo, k), i.u[2][k], [i.u[0][k], i.u[1][k]]);
        (0..COUNT).filter_map(of).map(|s| s.weight.r + s.weight.g + s.weight.b + s.pdf + s.wi.0.x).sum()
    };
    show("Bsdf", [time(|| eval_one(1)), time(|| eval_one(4)), time(sample_one)]);
    for set in InstructionSet::all() {
        let times = [
            time(|| dispatch!(set, F, token => eval::<F, RICH>(token, &surface, i, 1))),
            time(|| dispatch!(set, F, token => eval::<F, RICH>(token, &surface, i, 4))),
            time(|| dispatch!(set, F, token => sample::<F, RICH>(token, &surface, i))),
        ];
        show(&format!("{} lanes", set.lanes()), times);
    }
}

fn main() {
    let sampler = Sampler::new(1, 0, 0, 0);
    let mut i = Inputs { wo: [[0.0; COUNT]; 3], wi: [[[0.0; COUNT]; 3]; 4], u: [[0.0; COUNT]; 3] };
    for k in 0..COUNT {
        let [a, b, c, d] = sampler.get_4d(k as u32);
        let set = |to: &mut Vectors, v: [f32; 3]| (0..3).for_each(|axis| to[axis][k] = v[axis]);
        set(&mut i.wo, warp::sample_cosine_hemisphere([a, b]).to_array());
        for (light, wi) in i.wi.iter_mut().enumerate() {
            let turn = |x: f32| (x + 0.37 * light as f32).fract();
            set(wi, warp::sample_cosine_hemisphere([turn(c), turn(d)]).to_array());
        }
        set(&mut i.u, [c, d, (a + 0.5).fract()]);
    }
    println!("                        eval  4 x eval   sample");
    let plain = PrincipledParams::default();
    rates::<false>("plastic", plain, &i);
    rates::<false>("metal", PrincipledParams { metallic: 1.0, roughness: 0.2, anisotropic: 0.5, ..plain }, &i);
    rates::<true>("coat", PrincipledParams { clearcoat: 1.0, clearcoat_gloss: 0.7, ..plain }, &i);
    rates::<true>("rough glass", PrincipledParams { spec_trans: 1.0, roughness: 0.3, ..plain }, &i);
    let all = PrincipledParams { metallic: 0.3, spec_tint: 0.4, spec_trans: 0.4, sheen: 0.5, clearcoat: 0.8, ..plain };
    rates::<true>("all lobes", all, &i);
}
