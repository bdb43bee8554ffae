//! Materials of an MTL file as plain data: `tobj` reads the cleaned text, the PBR keys come from its unknown parameters.

use super::clean_mtl::{NAMELESS, NO_MODEL, clean};
use super::map::{self, Map};
use super::tally::Tally;
use std::panic::{AssertUnwindSafe, catch_unwind};

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

/// Reads the materials of a library. Those of the same name remain separate; the first one is used.
///
/// # Errors
/// If `tobj` does not accept the cleaned text.
pub(super) fn read(source: &str, tally: &mut Tally) -> Result<Vec<Mtl>, String> {
    let text = clean(source, tally);
    match catch_unwind(AssertUnwindSafe(|| tobj::load_mtl_buf(&mut text.as_bytes()))) {
        Ok(Ok((materials, _))) => Ok(materials.into_iter().map(Mtl::from).collect()),
        Ok(Err(e)) => Err(format!("cannot be read as a material library: {e}")),
        Err(_) => Err("cannot be read as a material library: the reader broke down".into()),
    }
}

impl From<tobj::Material> for Mtl {
    fn from(m: tobj::Material) -> Self {
        // The parameters are in random order. Each is found by its name.
        let parameter = |key: &str| m.unknown_param.get(key).map(String::as_str);
        let scalar = |key: &str| numbers::<1>(parameter(key)?).map(|[v]| v);
        let rgb = |color: Option<[f64; 3]>| color.map(|c| c.map(|v| v as f32));
        let map = |text: Option<&str>| map::read(text?, |_| ());
        Self {
            diffuse: rgb(m.diffuse),
            specular: rgb(m.specular),
            exponent: m.shininess.map(|v| v as f32),
            emission: rgb(m.emissive),
            filter: parameter("tf").and_then(numbers),
            dissolve: m.dissolve.map(|v| v as f32),
            ior: m.optical_density.map(|v| v as f32),
            illumination: m.illumination_model.filter(|model| *model != NO_MODEL).map(u32::from),
            roughness: scalar("pr"),
            metallic: scalar("pm"),
            sheen: scalar("ps"),
            clearcoat: scalar("pc"),
            clearcoat_roughness: scalar("pcr"),
            anisotropy: scalar("aniso"),
            anisotropy_rotation: scalar("anisor"),
            maps: Maps {
                diffuse: map(m.diffuse_texture.as_deref()),
                specular: map(m.specular_texture.as_deref()),
                exponent: map(m.shininess_texture.as_deref()),
                emission: map(parameter("map_ke")),
                dissolve: map(m.dissolve_texture.as_deref()),
                bump: map(m.normal_texture.as_deref()),
                normal: map(parameter("norm")),
                roughness: map(parameter("map_pr")),
                metallic: map(parameter("map_pm")),
                sheen: map(parameter("map_ps")),
                clearcoat: map(parameter("map_pc")),
                clearcoat_roughness: map(parameter("map_pcr")),
            },
            name: if m.name == NAMELESS { String::new() } else { m.name },
        }
    }
}

/// The first numbers of a parameter, which `tobj` keeps as text.
fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let mut values = text.split_whitespace().map_while(|word| word.parse::<f64>().ok());
    let mut numbers = [0.0; N];
    for slot in &mut numbers {
        *slot = values.next()? as f32;
    }
    Some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(source: &str) -> (Vec<Mtl>, Tally) {
        let mut tally = Tally::default();
        (super::read(source, &mut tally).expect(source), tally)
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

    #[test]
    fn materials_keep_their_order_and_may_have_no_name_or_the_same() {
        let (materials, _) = read("newmtl b\nPr 0.1\nnewmtl\nPr 0.2\nnewmtl b\nPr 0.3\npr 0.4\nPR x");
        let list: Vec<_> = materials.iter().map(|m| (m.name.as_str(), m.roughness)).collect();
        assert_eq!(list, [("b", Some(0.1)), ("", Some(0.2)), ("b", Some(0.4))]);
    }

    #[test]
    fn a_model_that_is_no_number_withdraws_the_one_before() {
        assert_eq!(read("newmtl a\nillum 7\nillum x").0[0].illumination, None);
        assert_eq!(read("newmtl a\nillum x\nillum 7").0[0].illumination, Some(7));
    }
}
