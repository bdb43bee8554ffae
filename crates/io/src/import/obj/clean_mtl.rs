//! The text of an MTL file in a form that `tobj` accepts. Statements that it would refuse or misread, or that would
//! make it fail, are rewritten or left out. The faults are counted with their lines.

use super::map;
use super::tally::Tally;
use super::text;
use std::borrow::Cow;

/// Name of a material without a name, which `tobj` refuses. No file can contain it, because a line ends at `\r`.
pub(super) const NAMELESS: &str = "-\r-";
/// Text of an illumination model that a later invalid one replaced.
pub(super) const NO_MODEL: u8 = u8::MAX;

/// Cleans a library. Keys have the spelling of `tobj`, or are in lower case if it does not support them. A colour has
/// three numbers, and all values are in range.
pub(super) fn clean(source: &str, tally: &mut Tally) -> String {
    let mut out = Out { text: String::with_capacity(source.len()), tally, line: 0, dissolves: None };
    for (line, content) in text::lines(source) {
        let (key, rest) = text::keyword(&content);
        if key.is_empty() || key.starts_with('#') {
            continue;
        }
        out.line = line;
        let key = key.to_ascii_lowercase();
        if key == "newmtl" {
            out.dissolves = Some(false);
            out.write("newmtl", if rest.is_empty() { NAMELESS } else { rest });
        } else if out.dissolves.is_some() {
            statement(&mut out, &key, rest);
        } else {
            out.warn("a statement before the first `newmtl` is ignored");
        }
    }
    out.text
}

struct Out<'a> {
    text: String,
    tally: &'a mut Tally,
    line: u32,
    /// Does the material have `d` or `Tr`? `None` before the first material.
    dissolves: Option<bool>,
}

impl Out<'_> {
    fn warn(&mut self, message: &str) {
        self.tally.add(self.line, message);
    }

    fn write(&mut self, key: &str, value: &str) {
        self.text.extend([key, " ", value, "\n"]);
    }

    fn dissolve(&mut self, value: &str) {
        self.dissolves = Some(true);
        self.write("d", value);
    }

    fn color(&mut self, key: &str, data: &str, most: f32) {
        if let Some(value) = color(self, data, most) {
            self.write(key, &value);
        }
    }

    fn scalar(&mut self, key: &str, data: &str, least: f32, most: f32) {
        if let Some((_, value)) = scalar(self, data, least, most) {
            self.write(key, &value);
        }
    }

    /// Options remain with the file's name. They are used when the material is converted.
    fn map(&mut self, key: &str, data: &str) {
        if map::read(data, |message| self.warn(message)).is_some() {
            self.write(key, data);
        }
    }
}

fn statement(out: &mut Out<'_>, key: &str, rest: &str) {
    let data = text::without_comment(rest);
    match key {
        "kd" => out.color("Kd", data, 1.0),
        "ks" => out.color("Ks", data, 1.0),
        "ke" => out.color("Ke", data, f32::MAX),
        "tf" | "kt" => out.color("tf", data, 1.0),
        "ns" => out.scalar("Ns", data, 0.0, f32::MAX),
        "ni" => out.scalar("Ni", data, 0.0, 100.0),
        "d" => {
            let data = data.strip_prefix("-halo").map_or(data, |rest| {
                out.warn("`-halo` is ignored; the dissolve holds for every direction");
                rest.trim()
            });
            if let Some((_, value)) = scalar(out, data, 0.0, 1.0) {
                out.dissolve(&value);
            }
        }
        // If both are given and differ, `d` is used: more programs write it correctly.
        "tr" if out.dissolves == Some(false) => {
            if let Some((value, _)) = scalar(out, data, 0.0, 1.0) {
                out.dissolve(&exactly(1.0 - value));
            }
        }
        "tr" => {}
        "illum" => {
            let model = scalar(out, data, 0.0, 10.0).map_or(NO_MODEL, |(value, _)| value as u8);
            out.write("illum", &model.to_string());
        }
        "pr" | "pm" | "ps" | "pc" | "pcr" => out.scalar(key, data, 0.0, 1.0),
        "aniso" | "anisor" => out.scalar(key, data, -1.0, 1.0),
        "map_kd" => out.map("map_Kd", rest),
        "map_ks" => out.map("map_Ks", rest),
        "map_ns" => out.map("map_Ns", rest),
        "map_d" | "map_opacity" => out.map("map_d", rest),
        "map_bump" | "bump" => out.map("bump", rest),
        "norm" | "map_kn" => out.map("norm", rest),
        "map_ke" | "map_pr" | "map_pm" | "map_ps" | "map_pc" | "map_pcr" => out.map(key, rest),
        "disp" | "map_disp" => out.warn("displacement maps are ignored; apply them before exporting"),
        "refl" | "map_refl" => out.warn("reflection maps are ignored: reflections are traced"),
        "decal" | "map_tr" | "map_tf" | "map_ni" | "map_aniso" | "map_anisor" => {
            out.warn(&format!("`{key}` is ignored"));
        }
        // Ambient light is computed, not given. The other keys control programs of their time.
        "ka" | "map_ka" | "km" | "sharpness" | "map_aat" | "interpolatemap" | "ridl" | "it" => {}
        _ => {
            let shown: String = key.chars().take(20).collect();
            out.warn(&format!("the unknown material statement `{shown}` is skipped"));
        }
    }
}

/// A number in range, and its text: that of the file, if `tobj` reads it as the same number.
fn scalar<'a>(out: &mut Out<'_>, data: &'a str, least: f32, most: f32) -> Option<(f32, Cow<'a, str>)> {
    let word = data.split_whitespace().next().unwrap_or("");
    match text::number(word).map(|(value, broken)| (value as f32, broken)) {
        Some((v, broken)) if v >= least && v <= most => {
            Some((v, if broken { Cow::Owned(exactly(v)) } else { Cow::Borrowed(word) }))
        }
        Some((v, _)) if !v.is_nan() => {
            out.warn(&format!("a value is outside {least} to {most} and was moved to the nearest of them"));
            let v = v.clamp(least, most);
            Some((v, Cow::Owned(exactly(v))))
        }
        _ => {
            out.warn("a value is not a number and is ignored");
            None
        }
    }
}

/// `r [g b]` or `xyz x [y z]` as the text of three numbers in range. One value is used for all three.
fn color<'a>(out: &mut Out<'_>, data: &'a str, most: f32) -> Option<Cow<'a, str>> {
    let (is_xyz, numbers) = match text::keyword(data) {
        ("spectral", _) => {
            out.warn("spectral curve files are not read; the colour is ignored");
            return None;
        }
        ("xyz", rest) => (true, rest),
        _ => (false, data),
    };
    let values: Vec<(f64, bool)> = numbers.split_whitespace().map_while(text::number).take(3).collect();
    let triple = match values.as_slice() {
        [r, g, b] => [r, g, b].map(|v| v.0 as f32),
        [v, ..] => [v.0 as f32; 3],
        [] => {
            out.warn("a colour holds no number and is ignored");
            return None;
        }
    };
    let rgb = if is_xyz { xyz_to_rgb(triple) } else { triple };
    if rgb.iter().any(|v| v.is_nan()) {
        out.warn("a colour is not a number and is ignored");
        return None;
    }
    let in_range = rgb.iter().all(|v| *v >= 0.0 && *v <= most);
    if !in_range {
        out.warn("a colour is out of range and was moved into it");
    }
    if in_range && !is_xyz && values.len() == 3 && !values.iter().any(|v| v.1) {
        return Some(Cow::Borrowed(data));
    }
    Some(Cow::Owned(rgb.map(|v| exactly(v.clamp(0.0, most))).join(" ")))
}

/// The number with as many digits as are needed to read the same number again.
fn exactly(v: f32) -> String {
    format!("{:?}", f64::from(v))
}

/// CIE XYZ to linear Rec. 709 (the inverse of the matrix that ITU-R BT.709 primaries and D65 white define).
fn xyz_to_rgb([x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        3.240_97 * x - 1.537_383_2 * y - 0.498_610_8 * z,
        -0.969_243_6 * x + 1.875_967_5 * y + 0.041_555_06 * z,
        0.055_630_08 * x - 0.203_976_96 * y + 1.056_971_5 * z,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_tobj_refuses_or_panics_at_are_rewritten() {
        for (statement, expected) in [
            ("Kd 0.5", "Kd 0.5 0.5 0.5\n"),
            ("Kd 0.1 0.2 0.3 # c", "Kd 0.1 0.2 0.3\n"),
            ("Kd", ""),
            ("KS 1 2 -1", "Ks 1.0 1.0 0.0\n"),
            ("Ka", ""),
            ("\tNs\t1e3", "Ns 1e3\n"),
            ("Ns 96,5", "Ns 96.5\n"),
            ("Ns", ""),
            ("Ni 1.#QNAN", ""),
            ("d -halo 0.5", "d 0.5\n"),
            ("d 0.5\nTr 0.75", "d 0.5\n"),
            ("Tr 0.75", "d 0.25\n"),
            ("illum 2.0", "illum 2\n"),
            ("illum x", "illum 255\n"),
            ("PR 0.5", "pr 0.5\n"),
            ("map_Kd", ""),
            ("map_kd -s 1 2 a b.png", "map_Kd -s 1 2 a b.png\n"),
            ("map_Kn n.png", "norm n.png\n"),
            ("foo 1", ""),
        ] {
            let text = clean(&format!("newmtl m\n{statement}\n"), &mut Tally::default());
            assert_eq!(text.strip_prefix("newmtl m\n"), Some(expected), "{statement}");
        }
        assert_eq!(clean("Kd 1 1 1\nnewmtl\n", &mut Tally::default()), format!("newmtl {NAMELESS}\n"));
    }
}
