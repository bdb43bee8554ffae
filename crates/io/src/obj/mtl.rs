//! The statements of an MTL file as plain data: the classic keys, the PBR keys, and texture references with options.

use super::tally::Tally;
use super::text;

/// A material as the file has it; `None` where it says nothing. Colours are linear.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mtl {
    /// `newmtl`, untouched.
    pub name: String,
    /// `Kd`: diffuse colour.
    pub diffuse: Option<[f32; 3]>,
    /// `Ks`: specular colour.
    pub specular: Option<[f32; 3]>,
    /// `Ns`: Blinn-Phong exponent.
    pub exponent: Option<f32>,
    /// `Ke`: emitted radiance.
    pub emission: Option<[f32; 3]>,
    /// `Tf` (or `Kt`): transmission filter.
    pub filter: Option<[f32; 3]>,
    /// `d`, or 1 - `Tr`.
    pub dissolve: Option<f32>,
    /// `Ni`: index of refraction.
    pub ior: Option<f32>,
    /// `illum`: illumination model.
    pub illumination: Option<u32>,
    /// `Pr`: roughness.
    pub roughness: Option<f32>,
    /// `Pm`: metallic.
    pub metallic: Option<f32>,
    /// `Ps`: sheen.
    pub sheen: Option<f32>,
    /// `Pc`: clear coat.
    pub clearcoat: Option<f32>,
    /// `Pcr`: roughness of the clear coat.
    pub clearcoat_roughness: Option<f32>,
    /// `aniso`: anisotropy.
    pub anisotropy: Option<f32>,
    /// `anisor`: its rotation, in turns.
    pub anisotropy_rotation: Option<f32>,
    /// The maps.
    pub maps: Maps,
}

/// Texture references of a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Maps {
    pub diffuse: Option<Map>,
    pub specular: Option<Map>,
    pub exponent: Option<Map>,
    pub emission: Option<Map>,
    pub dissolve: Option<Map>,
    pub bump: Option<Map>,
    pub normal: Option<Map>,
    pub roughness: Option<Map>,
    pub metallic: Option<Map>,
    pub sheen: Option<Map>,
    pub clearcoat: Option<Map>,
    pub clearcoat_roughness: Option<Map>,
}

/// A texture reference and its options.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    /// File name as written.
    pub file: String,
    /// `-o u v`: added to the scaled coordinates.
    pub offset: [f32; 2],
    /// `-s u v`: multiplies the coordinates.
    pub scale: [f32; 2],
    /// `-clamp on`.
    pub clamp: bool,
    /// `-bm`: strength of bumps.
    pub bump: f32,
    /// `-mm base gain`, as (base, gain).
    pub adjust: (f32, f32),
    /// `-imfchan`: r, g, b, m (matte), l (luminance) or z (depth).
    pub channel: Option<char>,
    /// `-colorspace`: is the image sRGB (true) or linear (false)?
    pub srgb: Option<bool>,
}

/// Reads the materials of a library; those of the same name stay separate, the first one counts.
pub(super) fn parse(source: &str, tally: &mut Tally) -> Vec<Mtl> {
    let mut materials: Vec<Mtl> = Vec::new();
    for (line, content) in text::lines(source) {
        let (key, rest) = text::keyword(&content);
        if key.is_empty() || key.starts_with('#') {
            continue;
        }
        let key = key.to_ascii_lowercase();
        if key == "newmtl" {
            materials.push(Mtl { name: rest.to_string(), ..Mtl::default() });
        } else if let Some(material) = materials.last_mut() {
            statement(material, line, &key, rest, tally);
        } else {
            tally.add(line, "a statement before the first `newmtl` is ignored");
        }
    }
    materials
}

fn statement(m: &mut Mtl, line: u32, key: &str, rest: &str, tally: &mut Tally) {
    let data = text::without_comment(rest);
    match key {
        "kd" => set(&mut m.diffuse, color(line, data, 1.0, tally)),
        "ks" => set(&mut m.specular, color(line, data, 1.0, tally)),
        "ke" => set(&mut m.emission, color(line, data, f32::MAX, tally)),
        "tf" | "kt" => set(&mut m.filter, color(line, data, 1.0, tally)),
        "ns" => set(&mut m.exponent, scalar(line, data, 0.0, f32::MAX, tally)),
        "ni" => set(&mut m.ior, scalar(line, data, 0.0, 100.0, tally)),
        "d" => {
            let value = data.strip_prefix("-halo").map_or(data, |rest| {
                tally.add(line, "`-halo` is ignored; the dissolve holds for every direction");
                rest.trim()
            });
            set(&mut m.dissolve, scalar(line, value, 0.0, 1.0, tally));
        }
        // Where both are given and disagree, `d` is the one that more programs write with care.
        "tr" if m.dissolve.is_none() => m.dissolve = scalar(line, data, 0.0, 1.0, tally).map(|v| 1.0 - v),
        "tr" => {}
        "illum" => m.illumination = scalar(line, data, 0.0, 10.0, tally).map(|v| v as u32),
        "pr" => set(&mut m.roughness, scalar(line, data, 0.0, 1.0, tally)),
        "pm" => set(&mut m.metallic, scalar(line, data, 0.0, 1.0, tally)),
        "ps" => set(&mut m.sheen, scalar(line, data, 0.0, 1.0, tally)),
        "pc" => set(&mut m.clearcoat, scalar(line, data, 0.0, 1.0, tally)),
        "pcr" => set(&mut m.clearcoat_roughness, scalar(line, data, 0.0, 1.0, tally)),
        "aniso" => set(&mut m.anisotropy, scalar(line, data, -1.0, 1.0, tally)),
        "anisor" => set(&mut m.anisotropy_rotation, scalar(line, data, -1.0, 1.0, tally)),
        "map_kd" => set(&mut m.maps.diffuse, map(line, rest, tally)),
        "map_ks" => set(&mut m.maps.specular, map(line, rest, tally)),
        "map_ns" => set(&mut m.maps.exponent, map(line, rest, tally)),
        "map_ke" => set(&mut m.maps.emission, map(line, rest, tally)),
        "map_d" | "map_opacity" => set(&mut m.maps.dissolve, map(line, rest, tally)),
        "map_bump" | "bump" => set(&mut m.maps.bump, map(line, rest, tally)),
        "norm" | "map_kn" => set(&mut m.maps.normal, map(line, rest, tally)),
        "map_pr" => set(&mut m.maps.roughness, map(line, rest, tally)),
        "map_pm" => set(&mut m.maps.metallic, map(line, rest, tally)),
        "map_ps" => set(&mut m.maps.sheen, map(line, rest, tally)),
        "map_pc" => set(&mut m.maps.clearcoat, map(line, rest, tally)),
        "map_pcr" => set(&mut m.maps.clearcoat_roughness, map(line, rest, tally)),
        "disp" | "map_disp" => tally.add(line, "displacement maps are ignored; apply them before exporting"),
        "refl" | "map_refl" => tally.add(line, "reflection maps are ignored: reflections are traced"),
        "decal" | "map_tr" | "map_tf" | "map_ni" | "map_aniso" | "map_anisor" => {
            tally.add(line, &format!("`{key}` is ignored"));
        }
        // Ambient light is computed, not given; the others steer programs of their time.
        "ka" | "map_ka" | "km" | "sharpness" | "map_aat" | "interpolatemap" | "ridl" | "it" => {}
        _ => {
            let shown: String = key.chars().take(20).collect();
            tally.add(line, &format!("the unknown material statement `{shown}` is skipped"));
        }
    }
}

/// Keeps an earlier value if the new one could not be read.
fn set<T>(slot: &mut Option<T>, value: Option<T>) {
    if value.is_some() {
        *slot = value;
    }
}

fn scalar(line: u32, data: &str, least: f32, most: f32, tally: &mut Tally) -> Option<f32> {
    let value = data.split_whitespace().next().and_then(text::number).map(|(v, _)| v as f32);
    match value {
        Some(v) if v >= least && v <= most => Some(v),
        Some(v) if !v.is_nan() => {
            tally.add(line, &format!("a value is outside {least} to {most} and was moved to the nearest of them"));
            Some(v.clamp(least, most))
        }
        _ => {
            tally.add(line, "a value is not a number and is ignored");
            None
        }
    }
}

/// `r [g b]` or `xyz x [y z]`; one value stands for three.
fn color(line: u32, data: &str, most: f32, tally: &mut Tally) -> Option<[f32; 3]> {
    let (is_xyz, numbers) = match text::keyword(data) {
        ("spectral", _) => {
            tally.add(line, "spectral curve files are not read; the colour is ignored");
            return None;
        }
        ("xyz", rest) => (true, rest),
        _ => (false, data),
    };
    let values: Vec<f32> = numbers.split_whitespace().map_while(text::number).map(|(v, _)| v as f32).take(3).collect();
    let triple = match values.as_slice() {
        [r, g, b] => [*r, *g, *b],
        [v, ..] => [*v; 3],
        [] => {
            tally.add(line, "a colour holds no number and is ignored");
            return None;
        }
    };
    let rgb = if is_xyz { xyz_to_rgb(triple) } else { triple };
    if rgb.iter().any(|v| v.is_nan()) {
        tally.add(line, "a colour is not a number and is ignored");
        return None;
    }
    if rgb.iter().any(|v| *v < 0.0 || *v > most) {
        tally.add(line, "a colour is out of range and was moved into it");
    }
    Some(rgb.map(|v| v.clamp(0.0, most)))
}

/// CIE XYZ to linear Rec. 709 (the inverse of the matrix that ITU-R BT.709 primaries and D65 white define).
fn xyz_to_rgb([x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        3.240_97 * x - 1.537_383_2 * y - 0.498_610_8 * z,
        -0.969_243_6 * x + 1.875_967_5 * y + 0.041_555_06 * z,
        0.055_630_08 * x - 0.203_976_96 * y + 1.056_971_5 * z,
    ]
}

/// A word of a statement and where it stands.
struct Word<'a> {
    text: &'a str,
    start: usize,
}

/// Reads options and file name. File names may hold spaces, and options may stand before or after them, so the name is
/// what lies between the leading and the trailing options.
fn map(line: u32, data: &str, tally: &mut Tally) -> Option<Map> {
    let words: Vec<Word<'_>> = data
        .split_whitespace()
        .map(|text| Word { text, start: text.as_ptr() as usize - data.as_ptr() as usize })
        .collect();
    let mut map = Map {
        file: String::new(),
        offset: [0.0; 2],
        scale: [1.0; 2],
        clamp: false,
        bump: 1.0,
        adjust: (0.0, 1.0),
        channel: None,
        srgb: None,
    };
    let mut at = 0;
    while let Some(length) = option(&mut map, line, &words[at..], tally) {
        at += length;
    }
    let name_start = at;
    while at < words.len() && !(at > name_start && option_arguments(words[at].text).is_some()) {
        at += 1;
    }
    let name_end = at;
    while let Some(length) = option(&mut map, line, &words[at..], tally) {
        at += length;
    }
    let start_of = |i: usize| words.get(i).map_or(data.len(), |w| w.start);
    let name = data.get(start_of(name_start)..start_of(name_end)).unwrap_or("").trim().trim_matches('"').trim();
    if name.is_empty() {
        tally.add(line, "a map names no file and is ignored");
        return None;
    }
    map.file = name.to_string();
    Some(map)
}

/// How many words may follow an option; `None` if the word is no option.
fn option_arguments(word: &str) -> Option<usize> {
    Some(match word.to_ascii_lowercase().as_str() {
        "-blendu" | "-blendv" | "-boost" | "-bm" | "-cc" | "-clamp" | "-colorspace" | "-imfchan" | "-texres"
        | "-type" => 1,
        "-mm" => 2,
        "-o" | "-s" | "-t" => 3,
        _ => return None,
    })
}

/// Reads one option at the start of `words` and tells how many words it took.
fn option(map: &mut Map, line: u32, words: &[Word<'_>], tally: &mut Tally) -> Option<usize> {
    let name = words.first()?.text.to_ascii_lowercase();
    let most = option_arguments(&name)?;
    let arguments = words.get(1..)?;
    // Of the numeric options the later numbers may be left out. "1.png" is a file, not a number.
    let numbers: Vec<f32> =
        arguments.iter().take(most).map_while(|w| w.text.parse::<f32>().ok().filter(|v| v.is_finite())).collect();
    let word = arguments.first().map_or("", |w| w.text);
    let on = word.eq_ignore_ascii_case("on");
    let first = numbers.first().copied();
    match name.as_str() {
        "-o" | "-s" => {
            let missing = if name == "-o" { 0.0 } else { 1.0 };
            let pair = [first.unwrap_or(missing), numbers.get(1).copied().unwrap_or(missing)];
            *(if name == "-o" { &mut map.offset } else { &mut map.scale }) = pair;
            return Some(1 + numbers.len());
        }
        "-t" => {
            if numbers.iter().any(|v| *v != 0.0) {
                tally.add(line, "turbulence (`-t`) of a map is ignored");
            }
            return Some(1 + numbers.len());
        }
        "-mm" => {
            map.adjust = (first.unwrap_or(0.0), numbers.get(1).copied().unwrap_or(1.0));
            return Some(1 + numbers.len());
        }
        "-bm" | "-boost" | "-texres" => {
            if name == "-bm" {
                map.bump = first.unwrap_or(1.0);
            }
            // `-texres 512x512` exists too; sharpness and stored resolution change nothing here.
            let takes_word = name == "-texres" && numbers.is_empty() && word.starts_with(|c: char| c.is_ascii_digit());
            return Some(1 + numbers.len().max(usize::from(takes_word)));
        }
        "-clamp" => map.clamp = on,
        "-cc" if on => tally.add(line, "colour correction (`-cc`) of a map is ignored"),
        "-type" => tally.add(line, "`-type` of a map is ignored: it is laid on by the texture coordinates"),
        "-imfchan" => map.channel = word.chars().next().map(|c| c.to_ascii_lowercase()),
        "-colorspace" => map.srgb = Some(word.eq_ignore_ascii_case("srgb")),
        _ => {}
    }
    Some(if arguments.is_empty() { 1 } else { 2 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(source: &str) -> (Vec<Mtl>, Tally) {
        let mut tally = Tally::default();
        (parse(source, &mut tally), tally)
    }

    fn diffuse_map(options: &str) -> Map {
        let (materials, _) = read(&format!("newmtl a\nmap_Kd {options}"));
        materials[0].maps.diffuse.clone().expect(options)
    }

    #[test]
    fn options_before_and_after_names_with_spaces() {
        let map = diffuse_map("-s 2 3 -o 0.5 -clamp on my texture 01.png");
        assert_eq!(
            (map.file.as_str(), map.scale, map.offset, map.clamp),
            ("my texture 01.png", [2.0, 3.0], [0.5, 0.0], true)
        );
        let map = diffuse_map("-imfchan r bumpmap2.jpg -bm 1.5");
        assert_eq!((map.file.as_str(), map.channel, map.bump), ("bumpmap2.jpg", Some('r'), 1.5));
        assert_eq!(diffuse_map("-s 1 1 1 1.png").file, "1.png");
        assert_eq!(diffuse_map("-texres 512 a.jpg").file, "a.jpg");
        assert_eq!(diffuse_map("-texres 512x512 a.jpg").file, "a.jpg");
        assert_eq!(diffuse_map("\"quoted name.png\"").file, "quoted name.png");
        assert_eq!(diffuse_map("dash - in -name.png").file, "dash - in -name.png");
        assert_eq!(diffuse_map("tex#1.png").file, "tex#1.png");
        let map = diffuse_map("-mm 0.1 0.3 -colorspace sRGB -blendu off -type sphere a.png");
        assert_eq!((map.file.as_str(), map.adjust, map.srgb), ("a.png", (0.1, 0.3), Some(true)));
    }

    #[test]
    fn maps_without_a_name_are_ignored() {
        for line in ["map_Kd", "map_Kd -s 1 2 3", "map_Kd -clamp", "map_Kd \"\"", "map_Kd -imfchan"] {
            assert_eq!(read(&format!("newmtl a\n{line}")).0[0].maps.diffuse, None, "{line}");
        }
    }

    #[test]
    fn values_in_all_spellings() {
        let (m, _) = read(
            "Kd 1 0 0\nnewmtl  a b \n\tKD .5\nKs xyz 0.9505 1 1.089\nTr 0.25\nNi 1.49\nillum 7\nKe 20 0 0\nNs 1e3",
        );
        assert_eq!(m.len(), 1);
        assert_eq!((m[0].name.as_str(), m[0].diffuse), ("a b", Some([0.5; 3])));
        let white = m[0].specular.expect("Ks");
        assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-3), "{white:?}");
        assert_eq!((m[0].dissolve, m[0].ior, m[0].illumination), (Some(0.75), Some(1.49), Some(7)));
        assert_eq!((m[0].emission, m[0].exponent), (Some([20.0, 0.0, 0.0]), Some(1000.0)));
    }

    #[test]
    fn d_wins_over_tr_in_any_order_and_nonsense_keeps_what_was() {
        assert_eq!(read("newmtl a\nd 0.75\nTr 0.5").0[0].dissolve, Some(0.75));
        assert_eq!(read("newmtl a\nTr 0.5\nd 0.75").0[0].dissolve, Some(0.75));
        assert_eq!(read("newmtl a\nNs 5\nNs x\nNs\nNs nan").0[0].exponent, Some(5.0));
        assert_eq!(
            read("newmtl a\nKd nan 0 0\nKs\nKe spectral file.rfl 1").0[0],
            Mtl { name: "a".into(), ..Mtl::default() }
        );
        assert_eq!(read("newmtl a\nKd -1 2 0.5").0[0].diffuse, Some([0.0, 1.0, 0.5]));
    }
}
