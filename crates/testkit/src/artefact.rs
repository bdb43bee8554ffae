//! Files that a failing test leaves behind, for viewing.

use std::fmt::Write as _;
use std::path::PathBuf;

/// Writes a table to `target/test-failures/<name>.csv`; returns a sentence that names the file, for the failure
/// message.
///
/// Never fails: if the file cannot be written, the sentence contains that.
pub(crate) fn write_csv(name: &str, header: &str, rows: impl IntoIterator<Item = Vec<f64>>) -> String {
    let mut text = format!("{header}\n");
    for row in rows {
        let cells: Vec<String> = row.iter().map(f64::to_string).collect();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{}", cells.join(","));
    }
    store(&format!("{name}.csv"), text.as_bytes())
}

/// Writes a grey image, scaled so that the largest value is white, to `target/test-failures/<name>.pgm`; returns a
/// sentence that names the file.
///
/// `values` are row by row from the top; missing ones, negative ones and NaN are black.
pub(crate) fn write_pgm(name: &str, width: usize, height: usize, values: &[f64]) -> String {
    let white = values.iter().copied().filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
    let mut bytes = format!("P5\n{width} {height}\n255\n").into_bytes();
    let grey = |i: usize| (values.get(i).copied().unwrap_or(0.0) / white * 255.0).round().clamp(0.0, 255.0) as u8;
    bytes.extend((0..width * height).map(grey));
    store(&format!("{name}.pgm"), &bytes)
}

fn store(file: &str, bytes: &[u8]) -> String {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../target"), PathBuf::from);
    let folder = target.join("test-failures");
    let file: String = file.chars().map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect();
    let path = folder.join(file);
    match std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, bytes)) {
        Ok(()) => format!("details in {}", path.display()),
        Err(e) => format!("details could not be written to {}: {e}", path.display()),
    }
}
