//! Texture references of an MTL file: a file name after options. `tobj` leaves both in one text.

use super::text::keyword;

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
}

/// Reads options and file name, which may contain spaces. Options without effect go to `warn`. `None` without a name.
pub(super) fn read(data: &str, mut warn: impl FnMut(&str)) -> Option<Map> {
    let mut map = Map { file: String::new(), offset: [0.0; 2], scale: [1.0; 2], clamp: false, bump: 1.0 };
    let mut rest = data.trim();
    loop {
        let (key, after) = keyword(rest);
        let (word, after_word) = keyword(after);
        let (numbers, after_numbers) = numbers(after);
        let number = |i: usize, missing: f32| numbers.get(i).copied().unwrap_or(missing);
        rest = match key {
            "-o" => {
                map.offset = [number(0, 0.0), number(1, 0.0)];
                after_numbers
            }
            "-s" => {
                map.scale = [number(0, 1.0), number(1, 1.0)];
                after_numbers
            }
            "-t" | "-mm" | "-cc" | "-type" | "-imfchan" | "-colorspace" => {
                warn(&format!("the option `{key}` of a map is ignored"));
                if matches!(key, "-t" | "-mm") { after_numbers } else { after_word }
            }
            "-bm" => {
                map.bump = number(0, 1.0);
                after_word
            }
            "-clamp" => {
                map.clamp = word == "on";
                after_word
            }
            // Filters and stored resolution have no effect here.
            "-blendu" | "-blendv" | "-boost" | "-texres" => after_word,
            _ => break,
        };
    }
    map.file = rest.trim_matches('"').trim().to_string();
    (!map.file.is_empty()).then_some(map)
}

/// At most three numbers at the start of a text, and the text after them. The last ones may be missing.
fn numbers(mut rest: &str) -> (Vec<f32>, &str) {
    let mut numbers = Vec::new();
    while numbers.len() < 3 {
        let (word, after) = keyword(rest);
        let Some(number) = word.parse().ok().filter(|v: &f32| v.is_finite()) else { break };
        numbers.push(number);
        rest = after;
    }
    (numbers, rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diffuse_map(data: &str) -> Map {
        read(data, |_| ()).expect(data)
    }

    #[test]
    fn options_precede_names_with_spaces() {
        let map = diffuse_map("-s 2 3 -o 0.5 -clamp on my texture 01.png");
        assert_eq!(
            (map.file.as_str(), map.scale, map.offset, map.clamp),
            ("my texture 01.png", [2.0, 3.0], [0.5, 0.0], true)
        );
        let map = diffuse_map("-imfchan r -bm 1.5 bumpmap2.jpg");
        assert_eq!((map.file.as_str(), map.bump), ("bumpmap2.jpg", 1.5));
        assert_eq!(diffuse_map("-s 1 1 1 1.png").file, "1.png");
        assert_eq!(diffuse_map("-texres 512x512 a.jpg").file, "a.jpg");
        assert_eq!(diffuse_map("\"quoted name.png\"").file, "quoted name.png");
        assert_eq!(diffuse_map("dash - in -name.png").file, "dash - in -name.png");
        assert_eq!(diffuse_map("tex#1.png").file, "tex#1.png");
        let map = diffuse_map("-mm 0.1 0.3 -colorspace sRGB -blendu off -type sphere a.png");
        assert_eq!(map.file, "a.png");
    }

    #[test]
    fn maps_without_a_name_are_none() {
        for data in ["", "-s 1 2 3", "-clamp", "\"\"", "-imfchan"] {
            assert_eq!(read(data, |_| ()), None, "{data}");
        }
    }
}
