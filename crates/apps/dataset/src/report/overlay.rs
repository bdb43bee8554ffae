//! Labels over an image of the page, as SVG: outlines of a mask or boxes, in the colour of their category.

use super::view::SetView;
use crate::make::bounds_of;
use crate::outline::outline;
use crate::record::Record;
use crate::visibility::Bounds;
use dunkelfeld::Error;
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
/// A mask that cannot be read.
pub(crate) fn overlay(view: &SetView<'_>, record: &Record) -> Result<Markup, Error> {
    let path = view.set.path().join(format!("masks/{:06}.png", record.index));
    let mask = match path.is_file() {
        true => Some(read_gray(&path, &Limits::default())?.values),
        false => None,
    };
    let outlines = mask.as_ref().map(outlines).unwrap_or_default();
    let gap = GAP * f64::from(record.width.max(record.height));
    let mut shapes = Vec::new();
    for label in &record.instances {
        let position = view.position(label.category).unwrap_or(COLORS - 1);
        let shape = match outlines.get(&label.id) {
            Some(Shape::Path(path)) => path.clone(),
            Some(Shape::Box(bounds)) => framed(*bounds, gap),
            None if mask.is_some() || label.area == 0 => continue,
            None => framed(label.bbox.map(f64::from), 0.0),
        };
        shapes.push((view.is_defect(position), position, shape));
    }
    shapes.sort_by_key(|(is_defect, ..)| *is_defect);
    Ok(html! {
        svg.labels viewBox={ "0 0 " (record.width) " " (record.height) } aria-hidden="true" {
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
fn outlines(mask: &Plane<u16>) -> BTreeMap<u16, Shape> {
    let (width, pixels) = (mask.width() as usize, mask.data());
    let small = SMALL * f64::from(mask.width().max(mask.height()));
    let shape = |id: u16, Bounds { from: [x0, y0], to: [x1, y1] }| {
        let bounds = [x0, y0, x1 - x0, y1 - y0];
        let boxed = Shape::Box(bounds.map(f64::from));
        if f64::from(bounds[2].max(bounds[3])) < small {
            return boxed;
        }
        let polygons = outline(bounds, |x, y| pixels.get(y * width + x) == Some(&id)).polygons;
        let corners: usize = polygons.iter().map(|polygon| polygon.len() / 2).sum();
        if corners > MOST_CORNERS { boxed } else { Shape::Path(polygons.iter().map(|p| path(p)).collect()) }
    };
    bounds_of(mask).into_iter().map(|(id, (bounds, _))| (id, shape(id, bounds))).collect()
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
    use crate::report::tests as fake;
    use dunkelfeld_io::picture::Picture;
    use dunkelfeld_io::png::png_bytes;
    use std::fs;

    #[test]
    fn categories_differ_in_colour_or_style() {
        let all: std::collections::BTreeSet<String> = (0..24).map(pen).collect();
        assert_eq!((all.len(), pen(24)), (24, pen(0)));
    }

    #[test]
    fn outlines_are_those_of_the_mask_and_small_instances_have_a_box() {
        let folder = tempfile::tempdir().expect("a folder");
        // A lid with a scratch of one pixel on it, and an id that no label has.
        let mask = Plane::from_fn(64, 32, |x, y| match (x, y) {
            (20, 12) => 3,
            (4..60, 4..28) => 4,
            (0, 0) => 9999,
            _ => 0,
        });
        let set = fake::write(folder.path(), &[fake::record(0)]);
        fs::create_dir_all(folder.path().join("masks")).expect("a folder");
        let bytes = png_bytes(Picture::Gray16(&mask)).expect("a picture");
        fs::write(folder.path().join("masks/000000.png"), bytes).expect("written");
        let drawn = || {
            let view = SetView::new(&set).expect("a set");
            overlay(&view, &set.record(0).expect("a record")).expect("labels").into_string()
        };
        let svg = drawn();
        let lid = "<path class=\"o o1\" d=\"M60,4 60,28 4,28 4,4 Z\">";
        let scratch = "<path class=\"o o0\" d=\"M19.36,11.36 21.64,11.36 21.64,13.64 19.36,13.64 Z\">";
        let places = [lid, scratch].map(|path| svg.find(path).unwrap_or_else(|| panic!("{path} in {svg}")));
        assert!(places[0] < places[1] && svg.matches("<path").count() == 2, "{svg}");
        // Without a mask the labels have their boxes.
        fs::remove_file(folder.path().join("masks/000000.png")).expect("there");
        let svg = drawn();
        assert!(svg.contains("M8,8 24,8 24,16 8,16 Z") && svg.matches("<path").count() == 2, "{svg}");
    }
}
