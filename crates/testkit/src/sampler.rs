//! One harness for every sampler: it follows its density, its inverse leads back, the ends of the unit square are safe,
//! and none of a folder's samplers is left out.
//!
//! The rule of names: `sample_x` draws, `pdf_x` is its density, `invert_x` gives the random numbers back; for a type that
//! is one sampler `sample`, `pdf` and `invert`.

use crate::{DensityTest, direction_to_square, sidak, square_to_direction};
use std::f64::consts::PI;
use std::path::Path;

/// A sampler with fixed parameters, described on the unit square: see [`SamplerCase::new`].
pub struct SamplerCase {
    function: String,
    case: String,
    sample: Box<dyn Fn([f32; 2]) -> Option<[f64; 2]>>,
    density: Box<dyn Fn([f64; 2]) -> f64>,
    round_trip: Option<RoundTrip>,
    grid: DensityTest,
}

/// The map that should be the identity, and the largest error it may have.
type RoundTrip = (Box<dyn Fn([f32; 2]) -> Option<[f32; 2]>>, f32);

impl SamplerCase {
    /// A case of the sampler `function`, named as in the source with the stem of its file: `"warp::sample_disk"`.
    ///
    /// `sample` takes random numbers in `[0, 1)` to a point of a unit square, or to nothing; `density` is per area of that
    /// square.
    pub fn new(
        function: &str,
        case: impl Into<String>,
        sample: impl Fn([f32; 2]) -> Option<[f64; 2]> + 'static,
        density: impl Fn([f64; 2]) -> f64 + 'static,
    ) -> Self {
        let grid = DensityTest { columns: 21, rows: 20, samples: 60_000 };
        let (sample, density) = (Box::new(sample), Box::new(density));
        Self { function: function.into(), case: case.into(), sample, density, round_trip: None, grid }
    }

    /// A sampler of directions, with its density per solid angle.
    pub fn directional(
        function: &str,
        case: impl Into<String>,
        sample: impl Fn([f32; 2]) -> Option<[f32; 3]> + 'static,
        pdf: impl Fn([f32; 3]) -> f32 + 'static,
    ) -> Self {
        Self::new(
            function,
            case,
            move |u| sample(u).map(direction_to_square),
            move |p| 4.0 * PI * f64::from(pdf(square_to_direction(p).map(|x| x as f32))),
        )
    }

    /// With the map from random numbers through sample and inverse back to random numbers. `tolerance` holds on the circle:
    /// a coordinate may be an angle.
    #[must_use]
    pub fn with_inverse(mut self, round_trip: impl Fn([f32; 2]) -> Option<[f32; 2]> + 'static, tolerance: f32) -> Self {
        self.round_trip = Some((Box::new(round_trip), tolerance));
        self
    }

    /// With another grid or number of samples.
    #[must_use]
    pub fn with_grid(mut self, grid: DensityTest) -> Self {
        self.grid = grid;
        self
    }

    fn name(&self) -> String {
        format!("{} {}", self.function, self.case)
    }
}

/// Chi-squared over all cases; `rate` is the false-alarm rate of all together.
///
/// # Panics
/// If a sampler does not follow its density: that is its use.
pub fn check_densities(cases: &[SamplerCase], rate: f64) {
    assert!(!cases.is_empty(), "no samplers");
    for (k, case) in cases.iter().enumerate() {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(k as u64 + 1);
        let mut uniform = || uniform(&mut state);
        let draw = || (case.sample)([uniform(), uniform()]);
        case.grid.run(&case.name(), draw, &case.density).assert(sidak(rate, cases.len()), &case.name());
    }
}

/// Sample and inverse are the identity on a grid of random numbers, wherever something is sampled.
///
/// # Panics
/// If they are not, or if a case with an inverse never gives anything.
pub fn check_inverses(cases: &[SamplerCase]) {
    for case in cases {
        let Some((round_trip, tolerance)) = &case.round_trip else { continue };
        let mut found = 0;
        for (i, j) in (0..40).flat_map(|i| (0..40).map(move |j| (i, j))) {
            let u = [(i as f32 + 0.37) / 40.0, (j as f32 + 0.61) / 40.0];
            let Some(v) = round_trip(u) else { continue };
            found += 1;
            let error = u.iter().zip(v).map(|(a, b)| (a - b).abs().min(1.0 - (a - b).abs())).fold(0.0, f32::max);
            assert!(error <= *tolerance, "{}: {u:?} came back as {v:?}", case.name());
            assert!(v.iter().all(|x| (0.0..=1.0).contains(x)), "{}: {u:?} came back as {v:?}", case.name());
        }
        assert!(found > 0, "{}: nothing was sampled", case.name());
    }
}

/// The corners, edges and middle lines of the unit square, up to the last number below one, give points of the square
/// with a density.
///
/// # Panics
/// If they do not.
pub fn check_corners(cases: &[SamplerCase]) {
    let last = 1.0 - f32::EPSILON / 2.0;
    let ends = [0.0, last, 0.5, 0.25, f32::MIN_POSITIVE, 1e-7];
    for case in cases {
        for u in ends.into_iter().flat_map(|a| ends.map(|b| [a, b])) {
            let Some(p) = (case.sample)(u) else { continue };
            assert!(p.iter().all(|x| (0.0..=1.0).contains(x)), "{}: {u:?} gives {p:?}", case.name());
            let density = (case.density)(p);
            assert!(density.is_finite() && density >= 0.0, "{}: {u:?} has density {density}", case.name());
            if let Some((round_trip, _)) = &case.round_trip {
                let v = round_trip(u);
                let inside = v.is_none_or(|v| v.iter().all(|x| (0.0..=1.0).contains(x)));
                assert!(inside, "{}: {u:?} came back as {v:?}", case.name());
            }
        }
    }
}

/// Every public sampler in the `.rs` files under `folder` has a density and an inverse beside it and a case in the list.
///
/// `exempt` names functions that need no case or have no inverse, with the reason.
///
/// # Panics
/// If one is missing, if an exemption is not needed, or if there is no sampler at all.
pub fn check_names(folder: impl AsRef<Path>, cases: &[SamplerCase], exempt: &[(&str, &str)]) {
    let mut files = Vec::new();
    collect(folder.as_ref(), &mut files);
    let mut problems = Vec::new();
    let mut samplers = Vec::new();
    for path in &files {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for rest in code.split("pub fn sample").skip(1) {
            let suffix: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if !suffix.is_empty() && !suffix.starts_with('_') {
                continue;
            }
            let name = format!("{stem}::sample{suffix}");
            if !exempt.iter().any(|(n, _)| *n == name) {
                for partner in ["pdf", "invert"] {
                    if !code.contains(&format!("pub fn {partner}{suffix}(")) {
                        problems.push(format!("{name} has no {partner}{suffix}"));
                    }
                }
                if !cases.iter().any(|c| c.function == name) {
                    problems.push(format!("{name} has no case"));
                }
            }
            samplers.push(name);
        }
    }
    assert!(!samplers.is_empty(), "no sampler under {}", folder.as_ref().display());
    problems.extend(
        exempt
            .iter()
            .filter(|(n, _)| !samplers.contains(&(*n).to_owned()))
            .map(|(n, _)| format!("{n} is exempt, but does not exist")),
    );
    problems.extend(
        cases
            .iter()
            .filter(|c| !samplers.contains(&c.function))
            .map(|c| format!("{} has a case, but does not exist", c.function)),
    );
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

fn collect(folder: &Path, files: &mut Vec<std::path::PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for path in entries.map(|e| e.unwrap_or_else(|e| panic!("{}: {e}", folder.display())).path()) {
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// A number in `[0, 1)` (Steele, Lea and Flood 2014, SplitMix).
fn uniform(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
}
