//! The tree of MVTec AD: the pictures in folders for the detection of anomalies, and masks of their defects.
//!
//! Source: Bergmann et al. 2021. Readers as that of anomalib take each picture below a folder, and pair the pictures of
//! `test/KIND/` with the masks of `ground_truth/KIND/` in the order of their names. So the tree has a folder of its own, in
//! it one for each capture, and names with six digits.

use crate::encode::{Files, encoded};
use crate::ids::Ids;
use crate::record::InstanceRecord;
use dunkelfeld::Error;
use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::png_bytes;
use std::collections::BTreeSet;

/// The folder of images without a defect.
const GOOD: &str = "good";
/// The folder of images with several kinds of defects.
const COMBINED: &str = "combined";

/// Can a category of defects be a folder of the tree?
pub(crate) fn is_kind(category: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    !category.is_empty() && category.chars().all(is_plain) && ![GOOD, COMBINED].contains(&category)
}

/// An image for the tree.
pub(crate) struct TreeImage<'a> {
    pub(crate) index: u64,
    /// Is it one of the images for training, which have no defects?
    pub(crate) is_training: bool,
    /// Has the scene a defect?
    pub(crate) is_defective: bool,
    pub(crate) instances: &'a [InstanceRecord],
    /// The mask of instances.
    pub(crate) mask: &'a Plane<u16>,
}

/// Adds the files of an image to those that it has in `images/`: a picture for each capture, and masks of its defects, 255 in
/// the union of their visible pixels. An image whose defects are all hidden is not in the tree: it shows none, and may contain
/// their shadows.
pub(crate) fn add_tree(files: &mut Files, image: &TreeImage<'_>, ids: &Ids) -> Result<(), Error> {
    let visible: Vec<&InstanceRecord> =
        image.instances.iter().filter(|instance| instance.defect.is_some() && instance.area > 0).collect();
    if image.is_defective && visible.is_empty() {
        return Ok(());
    }
    let kinds: BTreeSet<&str> = visible.iter().filter_map(|defect| ids.name_of(defect.category)).collect();
    let kind = if kinds.len() > 1 { COMBINED } else { kinds.first().copied().unwrap_or(GOOD) };
    let mut mask = None;
    if !visible.is_empty() {
        let defects: BTreeSet<u16> = visible.iter().map(|defect| defect.id).collect();
        let plane = image.mask.map(|id| if defects.contains(id) { u8::MAX } else { 0 });
        mask = Some(encoded("layout", png_bytes(Picture::Gray8(&plane)))?);
    }
    let part = if image.is_training { "train" } else { "test" };
    let prefix = format!("images/{:06}", image.index);
    let mut added = Files::new();
    for (name, content) in files.iter() {
        // `.png`, or `-CAPTURE.png`.
        let Some(rest) = name.strip_prefix(&prefix).and_then(|rest| rest.strip_suffix(".png")) else { continue };
        let root = rest.strip_prefix('-').map_or("mvtec".into(), |capture| format!("mvtec/{capture}"));
        added.push((format!("{root}/{part}/{kind}/{:06}.png", image.index), content.clone()));
        let masked =
            mask.iter().map(|mask| (format!("{root}/ground_truth/{kind}/{:06}_mask.png", image.index), mask.clone()));
        added.extend(masked);
    }
    files.append(&mut added);
    Ok(())
}
