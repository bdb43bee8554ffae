//! `dunkelfeld inspect`: the content of a scene, and its hazards.

use crate::args::InspectArgs;
use crate::outcome::{Outcome, print};
use crate::words::{counted, power, three_digits};
use dunkelfeld::inspect::{CoverEntry, EffectEntry, ObjectEntry};
use dunkelfeld::io::{visible_json, visible_line};
use dunkelfeld::{Error, Inspection, Project, ProjectOptions};
use std::fmt::Write;

pub(crate) fn run(args: &InspectArgs) -> Result<Outcome, Error> {
    let project = Project::open_with(&args.input, ProjectOptions::default().with_can_change(false))?;
    let inspection = project.inspect();
    if args.json {
        // Plain data with string keys: serialisation cannot fail.
        let json = serde_json::to_string_pretty(&inspection).unwrap_or_default();
        print(&format!("{}\n", visible_json(&json)));
    } else {
        print(&text(&inspection));
    }
    Ok(Outcome::Done)
}

fn text(i: &Inspection) -> String {
    let mut t = String::new();
    let _ = writeln!(
        t,
        "{}, {} placed, {} stored, {} instanced, {:.1} MB, {:.1} MB of it textures",
        counted(i.objects as u64, "object"),
        counted(i.placed_triangles, "triangle"),
        i.stored_triangles,
        counted(i.instanced_parts as u64, "part"),
        i.memory_bytes as f64 * 1e-6,
        i.texture_bytes as f64 * 1e-6
    );
    if let Some(memory) = &i.memory {
        let _ = writeln!(t, "memory of a render, about {:.0} MB\n{}", memory.peak_bytes as f64 * 1e-6, memory.table());
    }
    match i.bounds {
        Some([lo, hi]) => {
            let size: Vec<String> = (0..3).map(|k| format!("{:.4}", hi[k] - lo[k])).collect();
            let at: Vec<String> = lo.iter().map(|v| format!("{v:.4}")).collect();
            let _ = writeln!(t, "bounds {} m, lowest corner at {}", size.join(" x "), at.join(", "));
        }
        None => t += "no geometry\n",
    }
    section(&mut t, "objects", i.object_list.iter().take(MAX_OBJECTS).map(object_line));
    if let Some(more) = i.object_list.len().checked_sub(MAX_OBJECTS).filter(|more| *more > 0) {
        let _ = writeln!(t, "  and {more} more (--json lists all)");
    }
    section(&mut t, "cameras", i.cameras.iter().map(|c| format!("{:<28} {}", c.name, c.description)));
    section(
        &mut t,
        "lights",
        i.lights.iter().map(|l| {
            let radiance = l
                .radiance
                .map(|r| r.map(|v| three_digits(f64::from(v))).join(" "))
                .map(|r| format!(", radiance {r} W/(m^2 sr)"));
            let (watts, lumens) = (power(l.watts), three_digits(l.lumens));
            format!("{:<28} {}: {watts}, {lumens} lm{}", l.name, l.kind, radiance.unwrap_or_default())
        }),
    );
    if !i.lights.is_empty() {
        let _ = writeln!(t, "  ({})", i.light_choice);
    }
    section(
        &mut t,
        "materials",
        i.materials.iter().map(|m| format!("{:<28} {} ({} triangles)", m.name, m.description, m.triangles)),
    );
    section(&mut t, "clear covers", i.covers.iter().map(cover_line));
    section(&mut t, "effects that the scene uses", i.effects.iter().filter(|e| e.on).map(effect_line));
    let off: Vec<&str> = i.effects.iter().filter(|e| !e.on).map(|e| e.name.as_str()).collect();
    if !off.is_empty() {
        let _ = writeln!(t, "  off: {}", off.join(", "));
    }
    section(&mut t, "read with warnings", i.warnings.iter().cloned());
    section(&mut t, "repaired", i.notes.iter().cloned());
    section(&mut t, "hazards", i.hazards.iter().cloned());
    if i.hazards.is_empty() {
        t += "no hazards found\n";
    }
    section(&mut t, "hints", i.hints.iter().cloned());
    t
}

/// Maximum number of listed objects.
const MAX_OBJECTS: usize = 40;

/// `lid   0.1000 x 0.0050 x 0.1000 m at (0.000, 0.010, 0.000), 12 triangles, steel`; the place is the middle.
fn object_line(object: &ObjectEntry) -> String {
    let size = object.bounds.map_or_else(String::new, |[lo, hi]| {
        let [x, y, z] = [0, 1, 2].map(|k| 0.5 * (lo[k] + hi[k]));
        let [w, h, d] = [0, 1, 2].map(|k| hi[k] - lo[k]);
        format!("{w:.4} x {h:.4} x {d:.4} m at ({x:.4}, {y:.4}, {z:.4}), ")
    });
    format!("{:<28} {size}{}, {}", object.name, counted(object.triangles, "triangle"), object.materials.join(", "))
}

/// `moulded, across (0.000, 1.000, 0.000): pmma 4.133 mm (index 1.490)`.
fn cover_line(cover: &CoverEntry) -> String {
    let layers: Vec<String> = cover
        .layers
        .iter()
        .map(|layer| {
            let name = if layer.materials.is_empty() { "air".into() } else { layer.materials.join(" + ") };
            let index = if layer.materials.is_empty() { String::new() } else { format!(" (index {:.3})", layer.ior) };
            format!("{name} {:.3} mm{index}", 1e3 * layer.thickness)
        })
        .collect();
    let shape = if cover.flat { "flat" } else { "moulded" };
    let [x, y, z] = cover.axis;
    format!("{shape}, across ({x:.3}, {y:.3}, {z:.3}): {}", layers.join(", "))
}

/// Maximum number of listed causes of an effect.
const MAX_USERS: usize = 4;

fn effect_line(effect: &EffectEntry) -> String {
    let users = &effect.called_for_by;
    let mut words = users.iter().take(MAX_USERS).cloned().collect::<Vec<_>>().join(", ");
    if users.len() > MAX_USERS {
        let _ = write!(words, " and {} more", users.len() - MAX_USERS);
    }
    format!("{:<28} {words}", effect.name)
}

/// A heading with indented lines, or nothing if there are none.
fn section(text: &mut String, heading: &str, lines: impl Iterator<Item = String>) {
    let mut lines = lines.peekable();
    if lines.peek().is_some() {
        let _ = writeln!(text, "{heading}");
        for line in lines {
            let _ = writeln!(text, "  {}", visible_line(&line));
        }
    }
}
