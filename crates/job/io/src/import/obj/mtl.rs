//! Materials of an MTL file as plain data, read by `tobj`. The PBR keys come from its unknown parameters.

use super::map::{self, Map};
use super::text::first_refused;
use crate::import::warnings::Warnings;

/// A material as in the file. `None` where the file has no value. Colours are linear.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mtl {
    /// `newmtl`, unchanged.
    pub name: String,
    /// `Kd`: diffuse colour.
    pub diffuse: Option<[f32; 3]>,
    /// `Ks`: specular colour.
    pub specular: Option<[f32; 3]>,
    /// `Ns`: Blinn-Phong exponent.
    pub exponent: Option<f32>,
    /// `Ke`: emitted radiance.
    pub emission: Option<[f32; 3]>,
    /// `Tf`: transmission filter.
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

/// Keys that are read beside those of `tobj`.
const READ: &[&str] = &[
    "Tf", "Tr", "Pr", "Pm", "Ps", "Pc", "Pcr", "aniso", "anisor", "norm", "map_Ke", "map_Pr", "map_Pm", "map_Ps",
    "map_Pc", "map_Pcr",
];

/// Reads the materials of the library `file`. Those of the same name remain separate; the first one is used.
///
/// # Errors
/// The first line that `tobj` does not read, and the reason.
pub(super) fn read(source: &str, file: &str, warnings: &mut Warnings) -> Result<Vec<Mtl>, (u32, String)> {
    // `tobj` panics at such a line.
    let lacks_numbers = |line: &str| {
        let mut words = line.split_whitespace();
        matches!(words.next(), Some("Ka" | "Kd" | "Ks" | "Ke")) && words.count() < 3
    };
    match first_refused(source, lacks_numbers) {
        0 => {}
        line => return Err((line, "a colour has fewer than three numbers".into())),
    }
    let load = |text: &str| tobj::load_mtl_buf(&mut text.as_bytes());
    let (materials, _) =
        load(source).map_err(|e| (first_refused(source, |line| load(line).is_err()), e.to_string()))?;
    Ok(materials.into_iter().map(|m| Values { file, m: &m, warnings }.convert()).collect())
}

/// The values of one material, with warnings about those that are changed or left out.
struct Values<'a> {
    file: &'a str,
    m: &'a tobj::Material,
    warnings: &'a mut Warnings,
}

impl Values<'_> {
    fn convert(mut self) -> Mtl {
        let m = self.m;
        // The parameters are in random order.
        let mut unread: Vec<&str> = m.unknown_param.keys().map(String::as_str).filter(|k| !READ.contains(k)).collect();
        unread.sort_unstable();
        for key in unread {
            let shown: String = key.chars().take(20).collect();
            self.warn(&format!("the statement `{shown}` is ignored"));
        }
        Mtl {
            name: m.name.clone(),
            diffuse: self.color("Kd", m.diffuse, 1.0),
            specular: self.color("Ks", m.specular, 1.0),
            exponent: self.within("Ns", m.shininess, 0.0, f32::MAX),
            emission: self.color("Ke", m.emissive, f32::MAX),
            filter: self.filter(),
            // More programs write `d` correctly.
            dissolve: match m.dissolve {
                Some(d) => self.within("d", Some(d), 0.0, 1.0),
                None => self.scalar("Tr", 0.0).map(|v| 1.0 - v),
            },
            ior: self.within("Ni", m.optical_density, 0.0, 100.0),
            illumination: m.illumination_model.map(u32::from),
            roughness: self.scalar("Pr", 0.0),
            metallic: self.scalar("Pm", 0.0),
            sheen: self.scalar("Ps", 0.0),
            clearcoat: self.scalar("Pc", 0.0),
            clearcoat_roughness: self.scalar("Pcr", 0.0),
            anisotropy: self.scalar("aniso", -1.0),
            anisotropy_rotation: self.scalar("anisor", -1.0),
            maps: Maps {
                diffuse: self.map(m.diffuse_texture.as_ref()),
                specular: self.map(m.specular_texture.as_ref()),
                exponent: self.map(m.shininess_texture.as_ref()),
                emission: self.map(m.unknown_param.get("map_Ke")),
                dissolve: self.map(m.dissolve_texture.as_ref()),
                bump: self.map(m.normal_texture.as_ref()),
                normal: self.map(m.unknown_param.get("norm")),
                roughness: self.map(m.unknown_param.get("map_Pr")),
                metallic: self.map(m.unknown_param.get("map_Pm")),
                sheen: self.map(m.unknown_param.get("map_Ps")),
                clearcoat: self.map(m.unknown_param.get("map_Pc")),
                clearcoat_roughness: self.map(m.unknown_param.get("map_Pcr")),
            },
        }
    }

    fn warn(&mut self, message: &str) {
        self.warnings.push(format!("{}, material \"{}\"", self.file, self.m.name), message);
    }

    /// A value in its range. `None` if it is no number.
    fn within(&mut self, key: &str, value: Option<f64>, least: f32, most: f32) -> Option<f32> {
        let value = value? as f32;
        let inside = value.clamp(least, most);
        if value.is_nan() {
            self.warn(&format!("{key} is not a number and is ignored"));
        } else if inside != value {
            self.warn(&format!("{key} {value} is outside {least} to {most} and becomes {inside}"));
        }
        (!value.is_nan()).then_some(inside)
    }

    fn color(&mut self, key: &str, color: Option<[f64; 3]>, most: f32) -> Option<[f32; 3]> {
        let [r, g, b] = color?.map(|v| self.within(key, Some(v), 0.0, most));
        Some([r?, g?, b?])
    }

    /// The numbers at the start of a parameter, which `tobj` keeps as text.
    fn numbers(&mut self, key: &str) -> Option<Vec<f64>> {
        let text = self.m.unknown_param.get(key)?;
        let numbers: Vec<f64> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
        if numbers.is_empty() {
            self.warn(&format!("{key} is not a number and is ignored"));
        }
        Some(numbers).filter(|n| !n.is_empty())
    }

    /// A parameter from `least` to 1.
    fn scalar(&mut self, key: &str, least: f32) -> Option<f32> {
        let value = self.numbers(key)?.first().copied();
        self.within(key, value, least, 1.0)
    }

    /// `Tf r g b`, or `Tf v` for three equal values.
    fn filter(&mut self) -> Option<[f32; 3]> {
        let color = match *self.numbers("Tf")? {
            [r, g, b, ..] => [r, g, b],
            [v, ..] => [v; 3],
            [] => return None,
        };
        self.color("Tf", Some(color), 1.0)
    }

    fn map(&mut self, text: Option<&String>) -> Option<Map> {
        map::read(text?, |message| self.warn(message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(source: &str) -> Result<Vec<Mtl>, (u32, String)> {
        super::read(source, "a.mtl", &mut Warnings::new(std::path::Path::new("a.obj")))
    }

    fn material(source: &str) -> Mtl {
        read(source).expect(source).swap_remove(0)
    }

    #[test]
    fn values_are_read_and_moved_into_their_range() {
        let m =
            material("Kd 1 0 0\nnewmtl  a b \n\tKd -1 2 .5 # c\nTf 0.5\nTr 0.25\nNi 1.49\nillum 7\nKe 20 0 0\nNs 1e3");
        assert_eq!((m.name.as_str(), m.diffuse, m.filter), ("a b", Some([0.0, 1.0, 0.5]), Some([0.5; 3])));
        assert_eq!((m.dissolve, m.ior, m.illumination), (Some(0.75), Some(1.49), Some(7)));
        assert_eq!((m.emission, m.exponent), (Some([20.0, 0.0, 0.0]), Some(1000.0)));
        let nothing = Mtl { name: "a".into(), ..Mtl::default() };
        assert_eq!(material("newmtl a\nKd nan 0 0\nPr x\nTf\nNs nan"), nothing);
    }

    #[test]
    fn d_wins_over_tr_in_any_order() {
        assert_eq!(material("newmtl a\nd 0.75\nTr 0.5").dissolve, Some(0.75));
        assert_eq!(material("newmtl a\nTr 0.5\nd 0.75").dissolve, Some(0.75));
    }

    #[test]
    fn lines_that_tobj_refuses_or_panics_at_are_refused_with_their_number() {
        for line in
            ["Kd 0.5", "Ka", "Ks 1 1 x", "Kd xyz 1 1", "Ns", "Ni 1,5", "d -halo 1", "illum x", "map_Kd", "newmtl"]
        {
            assert_eq!(read(&format!("newmtl a\n{line}\n")).expect_err(line).0, 2, "{line}");
        }
    }
}
