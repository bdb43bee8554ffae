//! Labels over an image of the page, as SVG: outlines of a mask or boxes, in the colour of their category.

use super::error::ReportError;
use super::view::{HELP, Record, SetView};
use crate::outline::outline;
use dunkelfeld_film::Plane;
use dunkelfeld_io::gray::read_gray;
use dunkelfeld_io::loader::Limits;
use dunkelfeld_report::chart::COLORS;
use maud::{Markup, html};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Instances smaller than this share of the image have a box around them, because an outline would hide them.
const SMALL: f64 = 0.04;
/// Distance of a box from a small instance, as a share of the image.
const GAP: f64 = 0.01;
/// Instances with more corners have a box. This limits the size of the page.
const MOST_CORNERS: usize = 4000;

/// The labels of an image: outlines if there is a mask, boxes otherwise. Defects are drawn last.
///
/// # Errors
/// A mask that cannot be read, or that has another size than its image.
pub(crate) fn overlay(view: &SetView, record: &Record) -> Result<Markup, ReportError> {
    let path = view.path("masks", record.index, "png");
    let mask = match path.is_file() {
        true => {
            Some(read_gray(&path, &Limits::default()).map_err(|e| ReportError::new(&path, e.problem, HELP))?.values)
        }
        false => None,
    };
    let size = [record.width, record.height];
    if let Some(found) = mask.as_ref().map(|m| [m.width(), m.height()]).filter(|found| found.map(u64::from) != size) {
        let problem = format!(
            "the mask has {} \u{d7} {} pixels, its image has {} \u{d7} {}",
            found[0], found[1], size[0], size[1]
        );
        return Err(ReportError::new(&path, problem, HELP));
    }
    let outlines = mask.as_ref().map(outlines).unwrap_or_default();
    let gap = GAP * size[0].max(size[1]) as f64;
    let mut shapes = Vec::new();
    for label in &record.instances {
        let position = view.position(label.category).unwrap_or(COLORS - 1);
        let is_defect = view.head.categories.get(position).is_some_and(|c| c.is_defect);
        let shape = match outlines.get(&label.id) {
            Some(Shape::Path(path)) => path.clone(),
            Some(Shape::Box(bounds)) => framed(*bounds, gap),
            None if mask.is_some() => continue,
            None => match label.bbox.filter(|b| b.iter().all(|v| v.is_finite()) && b[2] > 0.0 && b[3] > 0.0) {
                Some(bounds) => framed(bounds, 0.0),
                None => continue,
            },
        };
        shapes.push((is_defect, position, shape));
    }
    shapes.sort_by_key(|(is_defect, ..)| *is_defect);
    Ok(html! {
        svg.labels viewBox={ "0 0 " (size[0].max(1)) " " (size[1].max(1)) } aria-hidden="true" {
            @for (_, position, shape) in &shapes { path class=(pen(*position)) d=(shape) {} }
        }
    })
}

/// The shape of an instance in a mask.
enum Shape {
    Path(String),
    /// Left, top, width, height [px].
    Box([f64; 4]),
}

/// The shapes of the instances of a mask, by their ids.
fn outlines(mask: &Plane<u16>) -> BTreeMap<u64, Shape> {
    let (width, pixels) = (mask.width() as usize, mask.data());
    // The first and the last column and row of each instance.
    let mut extents: BTreeMap<u16, [u32; 4]> = BTreeMap::new();
    for (at, id) in pixels.iter().enumerate().filter(|(_, id)| **id > 0) {
        let [x, y] = [at % width, at / width].map(|v| v as u32);
        let e = extents.entry(*id).or_insert([x, y, x, y]);
        *e = [e[0].min(x), e[1].min(y), e[2].max(x), e[3].max(y)];
    }
    let small = SMALL * f64::from(mask.width().max(mask.height()));
    let shape = |id: u16, [x0, y0, x1, y1]: [u32; 4]| {
        let bounds = [x0, y0, x1 - x0 + 1, y1 - y0 + 1];
        let boxed = Shape::Box(bounds.map(f64::from));
        if f64::from(bounds[2].max(bounds[3])) < small {
            return boxed;
        }
        let polygons = outline(bounds, |x, y| pixels.get(y * width + x) == Some(&id)).polygons;
        let corners: usize = polygons.iter().map(|polygon| polygon.len() / 2).sum();
        if corners > MOST_CORNERS { boxed } else { Shape::Path(polygons.iter().map(|p| path(p)).collect()) }
    };
    extents.into_iter().map(|(id, extent)| (u64::from(id), shape(id, extent))).collect()
}

/// A polygon as a path of SVG.
fn path(polygon: &[f64]) -> String {
    let mut path = String::from("M");
    for corner in polygon.chunks_exact(2) {
        // A text takes all that is written to it.
        let _ = write!(path, "{},{} ", corner[0], corner[1]);
    }
    path + "Z"
}

/// A box at a distance around bounds.
fn framed([x, y, w, h]: [f64; 4], gap: f64) -> String {
    let (x0, y0, x1, y1) = (x - gap, y - gap, x + w + gap, y + h + gap);
    path(&[x0, y0, x1, y0, x1, y1, x0, y1])
}

/// The classes of the lines of a category. Categories with the same colour have the styles of lines in turn.
pub(crate) fn pen(position: usize) -> String {
    let dash = ["", " dash", " dots", " both"][position / COLORS % 4];
    format!("o o{}{dash}", position % COLORS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake;
    use dunkelfeld_io::picture::Picture;
    use dunkelfeld_io::png::png_bytes;
    use std::fs;
    use std::path::Path;

    /// A set of one image with a mask of `size`, and its labels.
    fn drawn(folder: &Path, size: [u32; 2], id: impl Fn(u32, u32) -> u16) -> Result<String, ReportError> {
        fake::write(folder, &[fake::record(0)]);
        fs::create_dir_all(folder.join("masks")).expect("a folder");
        let ids = (0..size[0] * size[1]).map(|i| id(i % size[0], i / size[0])).collect();
        let mask = Plane::from_vec(size[0], size[1], ids).expect("a plane");
        let bytes = png_bytes(Picture::Gray16(&mask)).expect("a picture");
        fs::write(folder.join("masks/000000.png"), bytes).expect("written");
        let view = SetView::read(folder).expect("a set");
        Ok(overlay(&view, &view.record(0).expect("a record"))?.into_string())
    }

    #[test]
    fn categories_differ_in_colour_or_style() {
        let all: std::collections::BTreeSet<String> = (0..24).map(pen).collect();
        assert_eq!((all.len(), pen(24)), (24, pen(0)));
    }

    #[test]
    fn outlines_are_those_of_the_mask_and_small_instances_have_a_box() {
        let folder = tempfile::tempdir().expect("a folder");
        // A lid with a scratch of one pixel on it, and an id that no label has.
        let id = |x: u32, y: u32| match (x, y) {
            (20, 12) => 3,
            (4..60, 4..28) => 4,
            (0, 0) => 9999,
            _ => 0,
        };
        let svg = drawn(folder.path(), [64, 32], id).expect("labels");
        let lid = "<path class=\"o o1\" d=\"M60,4 60,28 4,28 4,4 Z\">";
        let scratch = "<path class=\"o o0\" d=\"M19.36,11.36 21.64,11.36 21.64,13.64 19.36,13.64 Z\">";
        let places = [lid, scratch].map(|path| svg.find(path).unwrap_or_else(|| panic!("{path} in {svg}")));
        assert!(places[0] < places[1] && svg.matches("<path").count() == 2, "{svg}");
        let error = drawn(folder.path(), [10, 10], |_, _| 0).expect_err("another size");
        assert!(error.file.ends_with("masks/000000.png") && error.problem.contains("10 \u{d7} 10"), "{error}");
        // Without a mask the labels have their boxes.
        fs::remove_file(folder.path().join("masks/000000.png")).expect("there");
        let view = SetView::read(folder.path()).expect("a set");
        let mut record = view.record(0).expect("a record");
        record.instances[1].bbox = Some([-1e30, f64::NAN, 1e30, 4.0]);
        let svg = overlay(&view, &record).expect("labels").into_string();
        assert!(svg.contains("M8,8 24,8 24,16 8,16 Z") && svg.matches("<path").count() == 1, "{svg}");
    }
}
