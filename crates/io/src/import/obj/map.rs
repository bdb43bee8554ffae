//! Texture references of an MTL file: a file name among options. `tobj` leaves both in one text.

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

/// A word of a statement and its position.
struct Word<'a> {
    text: &'a str,
    start: usize,
}

/// Reads options and file name. File names may contain spaces, and options may be before or after them. So the name is
/// the text between the leading and the trailing options.
///
/// `None` if there is no name. Faults and options without effect go to `warn`.
pub(super) fn read(data: &str, mut warn: impl FnMut(&str)) -> Option<Map> {
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
    while let Some(length) = option(&mut map, &words[at..], &mut warn) {
        at += length;
    }
    let name_start = at;
    while at < words.len() && !(at > name_start && option_arguments(words[at].text).is_some()) {
        at += 1;
    }
    let name_end = at;
    while let Some(length) = option(&mut map, &words[at..], &mut warn) {
        at += length;
    }
    let start_of = |i: usize| words.get(i).map_or(data.len(), |w| w.start);
    let name = data.get(start_of(name_start)..start_of(name_end)).unwrap_or("").trim().trim_matches('"').trim();
    if name.is_empty() {
        warn("a map names no file and is ignored");
        return None;
    }
    map.file = name.to_string();
    Some(map)
}

/// The maximum number of words after an option. `None` if the word is no option.
fn option_arguments(word: &str) -> Option<usize> {
    Some(match word.to_ascii_lowercase().as_str() {
        "-blendu" | "-blendv" | "-boost" | "-bm" | "-cc" | "-clamp" | "-colorspace" | "-imfchan" | "-texres"
        | "-type" => 1,
        "-mm" => 2,
        "-o" | "-s" | "-t" => 3,
        _ => return None,
    })
}

/// Reads one option at the start of `words` and returns how many words it took.
fn option(map: &mut Map, words: &[Word<'_>], warn: &mut impl FnMut(&str)) -> Option<usize> {
    let name = words.first()?.text.to_ascii_lowercase();
    let most = option_arguments(&name)?;
    let arguments = words.get(1..)?;
    // The last numbers of the numeric options may be missing. "1.png" is a file, not a number.
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
                warn("turbulence (`-t`) of a map is ignored");
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
            // `-texres 512x512` exists too. Sharpness and stored resolution have no effect here.
            let takes_word = name == "-texres" && numbers.is_empty() && word.starts_with(|c: char| c.is_ascii_digit());
            return Some(1 + numbers.len().max(usize::from(takes_word)));
        }
        "-clamp" => map.clamp = on,
        "-cc" if on => warn("colour correction (`-cc`) of a map is ignored"),
        "-type" => warn("`-type` of a map is ignored: the texture coordinates place the map"),
        "-imfchan" => map.channel = word.chars().next().map(|c| c.to_ascii_lowercase()),
        "-colorspace" => map.srgb = Some(word.eq_ignore_ascii_case("srgb")),
        _ => {}
    }
    Some(if arguments.is_empty() { 1 } else { 2 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diffuse_map(data: &str) -> Map {
        read(data, |_| ()).expect(data)
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
        for data in ["", "-s 1 2 3", "-clamp", "\"\"", "-imfchan"] {
            let mut warnings = Vec::new();
            assert_eq!(read(data, |w| warnings.push(w.to_string())), None, "{data}");
            assert_eq!(warnings, ["a map names no file and is ignored"], "{data}");
        }
    }
}
