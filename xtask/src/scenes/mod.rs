//! `cargo xtask scenes`: builds the scenes and jobs of `scenes/` and checks that the repository has them.
//!
//! `bracket.glb` is a part for a study. The set-up of `inspection/` is that of the paper (Kludt et al., *Noise analysis of a synthetically rendered scene in
//! sensor-realistic image simulation*): a housing of aluminium profiles, a dark field from three sides, a shuttered
//! light below, and a two-component moulded part under a clear cover. Metres, y up, the origin in the middle of the
//! symbols' plane, where the smallest gaps are and single precision is finest.

mod bracket;
mod cover;
mod glb;
mod jobs;
mod materials;
mod mesh;
mod outline;
mod part;
mod solids;
mod station;
mod symbols;

use std::fs;
use std::path::{Path, PathBuf};

use part::Cover;

/// The three scenes: stem of the file names, cover, and what sets it apart.
const SCENES: [(&str, Cover); 3] =
    [("inspection", Cover::Moulded), ("inspection-flat", Cover::Flat), ("inspection-open", Cover::None)];

/// Writes the files, or with `check` compares them with what the repository holds.
///
/// # Errors
/// Reports the file that cannot be written, is missing, or differs from the output of the code.
pub(crate) fn run(check: bool) -> Result<(), String> {
    let folder = folder();
    if check {
        return compare(&folder);
    }
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    for (name, bytes, triangles) in files() {
        let path = folder.join(&name);
        fs::write(&path, &bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("{name}: {} bytes{triangles}", bytes.len());
    }
    Ok(())
}

fn folder() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("..").join("scenes")
}

/// Every file: name, bytes, and the number of triangles in words, if it has any.
fn files() -> Vec<(String, Vec<u8>, String)> {
    let mut files = Vec::new();
    for (stem, cover) in SCENES {
        let document = station::scene(cover);
        let triangles = format!(", {} triangles", document.triangles());
        files.push((format!("inspection/{stem}.glb"), document.finish(), triangles));
        let job = jobs::job(stem, cover).into_bytes();
        files.push((format!("inspection/{stem}.toml"), job, String::new()));
    }
    files.push(("inspection/paper.toml".into(), jobs::PAPER.into(), String::new()));
    let bracket = bracket::scene();
    let triangles = format!(", {} triangles", bracket.triangles());
    files.push(("studies/bracket.glb".into(), bracket.finish(), triangles));
    files
}

fn compare(folder: &Path) -> Result<(), String> {
    for (name, bytes, _) in files() {
        let path = folder.join(&name);
        let stored = fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        if stored != bytes {
            return Err(format!(
                "scenes/{name} is not what the code makes; run `cargo xtask scenes` and commit the result"
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::solids::MM;
    use super::*;

    #[test]
    fn the_repository_holds_what_the_code_makes() {
        if let Err(message) = compare(&folder()) {
            panic!("{message}");
        }
    }

    #[test]
    fn bodies_are_closed_and_wind_outward() {
        let bodies = [
            ("base", part::base()),
            ("film", part::film_sheet()),
            ("bracket", bracket::bracket()),
            ("flat cover", cover::flat()),
            ("moulded cover", cover::moulded()),
            ("post", solids::post(5.0 * MM, 4.0 * MM, 0.3 * MM, 32)),
            ("screw", solids::screw(5.5 * MM)),
            ("profile", solids::slotted_profile(0.1)),
            ("box", solids::rounded_box(glam::DVec3::splat(0.01), MM, 0.5 * MM)),
            ("tube", solids::circle_tube([8.0 * MM, 15.0 * MM], 0.036, 0.5 * MM, 48)),
        ];
        for (name, mesh) in bodies {
            assert_eq!(mesh.open_edges(), 0, "{name} has open edges");
            assert!(mesh.volume() > 0.0, "{name} is inside out");
            // The smallest real facets are the 10 um strips of the screws' fillets.
            let area = mesh.smallest_area();
            assert!(area > 1e-11, "{name} has a triangle of {area} m^2");
            let cosine = mesh.worst_normal();
            assert!(cosine > 0.8, "{name} has a normal {cosine} off its face");
            for normal in &mesh.normals {
                assert!((normal.length() - 1.0).abs() < 1e-9, "{name}: {normal}");
            }
        }
    }

    #[test]
    fn the_moulded_cover_has_the_volume_of_its_drawing() {
        // A slab of 76 x 56 x 4 mm less its corners and rim, plus the difference of the two bulges:
        // the mean of (1 - u^2)(1 - v^2) over the square is 4/9.
        let slab = (76.0 * 56.0 - (4.0 - std::f64::consts::PI) * 25.0) * 4.0;
        let bulge = 76.0 * 56.0 * (4.0 / 9.0) * 0.3;
        let rim = (2.0 * (76.0 + 56.0) - 8.0 * 5.0 + 31.4) * (2.0 - std::f64::consts::FRAC_PI_2);
        let expected = (slab + bulge - rim) * 1e-9;
        let volume = cover::moulded().volume();
        let error = (volume / expected - 1.0).abs();
        assert!(error < 0.005, "{volume} m^3, drawn {expected} m^3");
    }

    #[test]
    fn layers_keep_their_distance() {
        let least = 20e-6;
        let film = part::film_sheet();
        let lowest = film.positions.iter().map(|p| p.y).fold(f64::MAX, f64::min);
        assert!(lowest - part::FLOOR > least, "film at {lowest} m, floor at {} m", part::FLOOR);
        let highest = film.positions.iter().map(|p| p.y).fold(f64::MIN, f64::max);
        assert!(cover::GAP - highest > 0.5 * MM, "film at {highest} m under the cover");

        // Ink over film: compare both triangulations where they differ most, at centroids of ink triangles and at
        // centres of film cells.
        for (number, symbol) in symbols::all().into_iter().enumerate() {
            let ink = part::drape(&symbol.drawing, part::symbol_centre(number));
            for t in &ink.triangles {
                let c = t.map(|i| ink.positions[i as usize]);
                let centre = (c[0] + c[1] + c[2]) / 3.0;
                let plan = DVec2::new(centre.x, -centre.z);
                assert!(plan.abs().cmplt(part::FILM_HALF).all(), "{} leaves the film", symbol.name);
                // A film cell is 1 mm: its chord rises above the surface by at most a few micrometres.
                let gap = centre.y - part::film_height(plan);
                assert!(gap > least + 5e-6, "{} is {gap} m above the film", symbol.name);
                let area = 0.5 * (c[1] - c[0]).cross(c[2] - c[0]).length();
                assert!(area > 1e-10, "{} has a triangle of {area} m^2", symbol.name);
            }
        }
    }

    #[test]
    fn symbols_do_not_cover_themselves_twice() {
        // Coverage would be wrong where patches overlap: no point of a fine grid may lie in two triangles.
        for symbol in symbols::all() {
            let d = &symbol.drawing;
            for i in 0..160 {
                for j in 0..160 {
                    let p = DVec2::new(f64::from(i) - 79.613, f64::from(j) - 79.381) * 0.083;
                    let hits = d.triangles.iter().filter(|t| {
                        let [a, b, c] = t.map(|k| d.points[k as usize]);
                        (b - a).perp_dot(p - a) > 0.0 && (c - b).perp_dot(p - b) > 0.0 && (a - c).perp_dot(p - c) > 0.0
                    });
                    assert!(hits.count() < 2, "{} overlaps itself at {p}", symbol.name);
                }
            }
        }
    }
}
