//! `[[study.label]]`: categories of objects, and key points on them.

use crate::distribution::Fault;
use dunkelfeld_geometry::DVec3;
use dunkelfeld_io::quantity::Length;
use serde::Deserialize;
use toml::Value;

/// The places where the label of an object is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum LabelSight {
    /// Where the surface scatters, or covers a part of the light. Labels are seen through a clear surface.
    #[default]
    Surface,
    /// Everywhere: an added defect may be as clear as what contains it, such as a bubble, and an object that was opaque and
    /// is missing or faded shows little or nothing.
    Everywhere,
    /// Where no label is seen behind: a clear object that is missing or faded.
    Behind,
}

/// `[[study.label]]`: objects that are labelled.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LabelEntry {
    /// Name of the category.
    pub(crate) category: String,
    /// Names or patterns of objects. Each object is an instance.
    pub(crate) objects: Names,
    /// Key points of each of the objects.
    #[serde(default)]
    pub(crate) keypoints: Vec<KeyPoint>,
    /// Pairs of key points that a line joins, as positions in `keypoints` from 1.
    #[serde(default)]
    pub(crate) skeleton: Vec<[u32; 2]>,
}

/// One name or several.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "expected a name in quotes, or a list of names")]
pub(crate) enum Names {
    One(String),
    Several(Vec<String>),
}

impl Names {
    /// The fault of a list without a name; the key is that of the list.
    pub(crate) fn check(&self, key: &str) -> Result<(), Fault> {
        if self.patterns().is_empty() {
            return Err(Fault::new("the list is empty", "write names or patterns of objects").below(key));
        }
        Ok(())
    }

    pub(crate) fn patterns(&self) -> &[String] {
        match self {
            Self::One(name) => std::slice::from_ref(name),
            Self::Several(names) => names,
        }
    }

    /// Does one of the patterns match a name?
    pub(crate) fn match_name(&self, name: &str) -> bool {
        self.patterns().iter().any(|pattern| dunkelfeld_io::job::matches(pattern, name))
    }
}

/// The texts of a value: a text, or those of a list.
pub(crate) fn texts(value: &Value) -> Vec<String> {
    match value {
        Value::String(text) => vec![text.clone()],
        Value::Array(items) => items.iter().flat_map(texts).collect(),
        _ => Vec::new(),
    }
}

/// A key point of an object.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KeyPoint {
    pub(crate) name: String,
    /// Position \[m\] in the frame of the object: origin and axes of the vertices of its meshes, and the lengths after the
    /// import.
    at: [Length; 3],
}

impl KeyPoint {
    /// Position \[m\] in the frame of the object.
    pub(crate) fn position(&self) -> DVec3 {
        DVec3::from(self.at.map(|length| length.0))
    }
}

impl LabelEntry {
    fn names(&self) -> impl Iterator<Item = &str> {
        self.keypoints.iter().map(|point| point.name.as_str())
    }

    fn check(&self) -> Result<(), Fault> {
        if self.category.is_empty() {
            return Err(Fault::new("a category has no name", "write `category`").below("category"));
        }
        self.objects.check("objects")?;
        for (i, point) in self.keypoints.iter().enumerate() {
            if point.name.is_empty() || self.names().take(i).any(|name| name == point.name) {
                let problem = format!("the name \"{}\" of the key point is empty, or is there twice", point.name);
                let fault = Fault::new(problem, "give each key point of a category its own name");
                return Err(fault.below(i.to_string()).below("keypoints"));
            }
        }
        let count = self.keypoints.len() as u32;
        for (i, pair) in self.skeleton.iter().enumerate() {
            if pair[0] == pair[1] || pair.iter().any(|number| !(1..=count).contains(number)) {
                let problem = format!("{pair:?} joins no two of the {count} key points");
                let help = "write pairs of different positions in `keypoints`, counted from 1";
                return Err(Fault::new(problem, help).below(i.to_string()).below("skeleton"));
            }
        }
        Ok(())
    }
}

/// Checks the entries of a study: the number of the entry with a fault, and the fault. The entries of a category have the
/// same names of key points and the same lines between them; positions may differ.
pub(crate) fn check(entries: &[LabelEntry]) -> Result<(), (usize, Fault)> {
    for (i, entry) in entries.iter().enumerate() {
        entry.check().map_err(|fault| (i, fault))?;
        let Some(first) = entries[..i].iter().find(|other| other.category == entry.category) else { continue };
        if !first.names().eq(entry.names()) || first.skeleton != entry.skeleton {
            let problem = format!("an entry before has other key points for the category \"{}\"", entry.category);
            let help = "give the entries of a category the same names of key points in one order and the same \
                `skeleton`, or use another category";
            return Err((i, Fault::new(problem, help).below("keypoints")));
        }
    }
    Ok(())
}
