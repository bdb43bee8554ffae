//! The contact sheet: images of a set in a grid, with their labels, as one PNG.

use super::error::ReportError;
use super::font;
use super::overlay::{COLORS, Overlay, style_of};
use super::picture::{Mask, Pixels, png};
use super::view::{Record, SetView, image_ending};
use dunkelfeld_report::words::shortened;
use std::collections::BTreeSet;

/// Colours of the sheet: background, and text.
const PAPER: [u8; 3] = [24, 29, 34];
const INK: [u8; 3] = [214, 221, 228];
/// Distance from the edges, between cells, and of an index from its image [px].
const MARGIN: u32 = 14;
const GAP: u32 = 10;
const BELOW: u32 = 5;
/// Pixels per dot of the font.
const SCALE: u32 = 2;
/// Height of a line of the legend [px].
const LINE: u32 = 24;
/// Distance of two entries of the legend [px].
const SPACE: u32 = 26;
/// Maximum number of characters of a name in the legend.
const LONGEST: usize = 36;
/// The ratio of width to height that a sheet approaches.
const ASPECT: f64 = 1.5;

/// Maximum number of images of a sheet.
pub(crate) const MOST_IMAGES: usize = 24;
/// The long side of an image in the sheet [px].
pub(crate) const CELL: u32 = 256;

/// An image scaled down, with its labels.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(crate) index: u64,
    pub(crate) pixels: Pixels,
    pub(crate) labels: Overlay,
    /// Positions of its categories in the set.
    pub(crate) categories: BTreeSet<usize>,
    /// Number of labels.
    pub(crate) instances: usize,
}

impl Shown {
    /// Reads an image, scales it to the size that `size` returns, and draws its labels.
    pub(crate) fn read(view: &SetView, index: u64, size: impl Fn(&Pixels) -> [u32; 2]) -> Result<Self, ReportError> {
        let record: Record = view.record(index)?;
        let ending = image_ending(&view.folder, index);
        let image = Pixels::read(&view.path("images", index, ending))?;
        let path = view.path("masks", index, "png");
        let mask = Mask::read(&path)?;
        let full = [image.width, image.height];
        if let Some(mask) = mask.as_ref().filter(|m| [m.width, m.height] != full) {
            let problem = format!(
                "the mask has {} \u{d7} {} pixels, its image has {} \u{d7} {}",
                mask.width, mask.height, full[0], full[1]
            );
            return Err(ReportError::new(&path, problem, "delete the record of the image, and run the command again"));
        }
        let size = size(&image);
        Ok(Self {
            index,
            pixels: image.shrunk(size),
            labels: Overlay::new(view, &record, mask.as_ref(), full, size),
            categories: record.instances.iter().filter_map(|l| view.position(l.category)).collect(),
            instances: record.instances.len(),
        })
    }

    fn rgb(&self) -> Vec<u8> {
        match self.pixels.channels {
            1 => self.pixels.data.iter().flat_map(|v| [*v; 3]).collect(),
            _ => self.pixels.data.clone(),
        }
    }
}

/// An RGB picture that is drawn on.
struct Canvas {
    width: u32,
    height: u32,
    rgb: Vec<u8>,
}

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        Self { width, height, rgb: PAPER.repeat(width as usize * height as usize) }
    }

    fn set(&mut self, [x, y]: [u32; 2], color: [u8; 3]) {
        let at = 3 * (y as usize * self.width as usize + x as usize);
        if let Some(pixel) = self.rgb.get_mut(at..at + 3).filter(|_| x < self.width) {
            pixel.copy_from_slice(&color);
        }
    }

    fn text(&mut self, [x, y]: [u32; 2], text: &str) {
        font::dots(text, SCALE).for_each(|[dx, dy]| self.set([x + dx, y + dy], INK));
    }

    fn picture(&mut self, [x, y]: [u32; 2], width: u32, rgb: &[u8]) {
        for (row, line) in (y..).zip(rgb.chunks_exact(3 * width.max(1) as usize)) {
            let at = 3 * (row as usize * self.width as usize + x as usize);
            if let Some(target) = self.rgb.get_mut(at..at + line.len()) {
                target.copy_from_slice(line);
            }
        }
    }

    /// The sign of a category: a square frame in its colour.
    fn swatch(&mut self, [x, y]: [u32; 2], category: usize) {
        const SIDE: u32 = 14;
        for (dx, dy) in (0..SIDE).flat_map(|dy| (0..SIDE).map(move |dx| (dx, dy))) {
            let depth = dx.min(dy).min(SIDE - 1 - dx).min(SIDE - 1 - dy);
            let is_gap = match style_of(category) {
                0 => false,
                1 => (5..9).contains(&dx) || (5..9).contains(&dy),
                2 => (dx % 4 >= 2) != (dy % 4 >= 2),
                _ => (6..8).contains(&dx) || (9..12).contains(&dy),
            };
            let color = if depth < 3 && !is_gap { COLORS[category % COLORS.len()] } else { [0; 3] };
            self.set([x + dx, y + dy], color);
        }
    }
}

/// Draws the contact sheet with at most `most` images, distributed evenly over the set. Their long sides are `cell` [px], but
/// images are not enlarged. Returns the bytes of a PNG file. A set without finished images has a sheet with a note.
pub(crate) fn contact_sheet(set: &SetView, most: usize, cell: u32) -> Result<Vec<u8>, ReportError> {
    let chosen = set.evenly(most);
    let shown: Result<Vec<Shown>, _> =
        chosen.iter().map(|index| Shown::read(set, *index, |image| image.size_within(cell))).collect();
    let shown = shown?;
    let canvas = drawn(set, &shown);
    png(&canvas.rgb, [canvas.width, canvas.height], 3)
}

fn drawn(set: &SetView, shown: &[Shown]) -> Canvas {
    let widest = shown.iter().map(|s| s.pixels.width).max().unwrap_or(0);
    let highest = shown.iter().map(|s| s.pixels.height).max().unwrap_or(0);
    // An index needs its width also below narrow images.
    let index = shown.iter().map(|s| font::width(&s.index.to_string(), SCALE)).max().unwrap_or(0);
    let pitch = [widest.max(index) + GAP, highest + BELOW + font::HEIGHT * SCALE + GAP];
    let columns = columns(shown.len() as u32, pitch);
    let rows = (shown.len() as u32).div_ceil(columns);
    let entries = legend(set, shown);
    let longest = entries.iter().map(|e| e.1).max().unwrap_or(0);
    let width = (columns * pitch[0] - GAP.min(columns * pitch[0])).max(longest) + 2 * MARGIN;
    let lines = wrapped(&entries, width - 2 * MARGIN);
    let foot = MARGIN + rows * pitch[1] + GAP / 2;
    let mut canvas = Canvas::new(width, foot + lines.len() as u32 * LINE + MARGIN / 2);
    for (i, image) in (0..).zip(shown) {
        let (x, y) = (MARGIN + i % columns * pitch[0], MARGIN + i / columns * pitch[1]);
        let (size, mut rgb) = ([image.pixels.width, image.pixels.height], image.rgb());
        let top = y + (highest - size[1]) / 2;
        image.labels.blend(&mut rgb);
        canvas.picture([x + (widest - size[0]) / 2, top], size[0], &rgb);
        canvas.text([x, y + highest + BELOW], &image.index.to_string());
    }
    for (line, y) in lines.iter().zip((foot..).step_by(LINE as usize)) {
        let mut x = MARGIN;
        for (entry, width) in *line {
            match entry {
                Entry::Category(category, name) => {
                    canvas.swatch([x, y], *category);
                    canvas.text([x + 22, y], name);
                }
                Entry::Note(text) => canvas.text([x, y], text),
            }
            x += width + SPACE;
        }
    }
    canvas
}

/// An entry of the legend.
enum Entry {
    Category(usize, String),
    Note(String),
}

/// The entries of the legend with their widths [px]: categories of the images, in the order of the set.
fn legend(set: &SetView, shown: &[Shown]) -> Vec<(Entry, u32)> {
    if shown.is_empty() {
        let text = String::from("no finished images");
        let width = font::width(&text, SCALE);
        return vec![(Entry::Note(text), width)];
    }
    let found: BTreeSet<usize> = shown.iter().flat_map(|s| &s.categories).copied().collect();
    let named = found.into_iter().filter_map(|i| Some((i, set.head.categories.get(i)?)));
    let entry = |(i, category): (usize, &super::view::Category)| {
        // The font has no ellipsis.
        let name = shortened(&category.name, LONGEST).replace('\u{2026}', ".");
        let width = 22 + font::width(&name, SCALE);
        (Entry::Category(i, name), width)
    };
    named.map(entry).collect()
}

/// The entries in lines of a width [px].
fn wrapped(entries: &[(Entry, u32)], width: u32) -> Vec<&[(Entry, u32)]> {
    let (mut lines, mut start, mut used) = (Vec::new(), 0, 0);
    for (i, (_, length)) in entries.iter().enumerate() {
        if used > 0 && used + length > width {
            lines.extend(entries.get(start..i));
            (start, used) = (i, 0);
        }
        used += length + SPACE;
    }
    lines.extend(entries.get(start..).filter(|rest| !rest.is_empty()));
    lines
}

/// The number of columns for which the sheet is nearest to its ratio, with few empty cells.
fn columns(n: u32, pitch: [u32; 2]) -> u32 {
    let badness = |columns: u32| {
        let rows = n.div_ceil(columns);
        let aspect = f64::from(columns * pitch[0]) / f64::from(rows * pitch[1]);
        (aspect / ASPECT).ln().abs() + f64::from(columns * rows - n) / f64::from(n)
    };
    (1..=n).min_by(|a, b| badness(*a).total_cmp(&badness(*b))).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake;
    use std::fs;
    use std::path::Path;

    /// A set of grey images of one value, with the size of the fake records, or another one.
    fn set(folder: &Path, n: u64, [width, height]: [u32; 2]) -> SetView {
        fake::write(folder, &(0..n).map(fake::record).collect::<Vec<_>>());
        fs::create_dir_all(folder.join("images")).expect("a folder");
        for index in 0..n {
            let data = vec![100 + index as u8; (width * height) as usize];
            let bytes = png(&data, [width, height], 1).expect("a picture");
            fs::write(folder.join(format!("images/{index:06}.png")), bytes).expect("written");
        }
        SetView::read(folder).expect("a set")
    }

    fn sheet(view: &SetView, most: usize, cell: u32) -> image::RgbImage {
        let bytes = contact_sheet(view, most, cell).expect("a sheet");
        image::load_from_memory(&bytes).expect("a picture").into_rgb8()
    }

    #[test]
    fn a_sheet_has_its_images_at_their_places() {
        let folder = tempfile::tempdir().expect("a folder");
        let view = set(folder.path(), 4, [64, 32]);
        let sheet = sheet(&view, 4, 32);
        // Cells of 32 x 16 in two columns and two rows are nearest to the ratio; the legend is one line.
        let pitch = [32 + GAP, 16 + BELOW + 14 + GAP];
        assert_eq!(sheet.height(), MARGIN + 2 * pitch[1] + GAP / 2 + 2 * LINE + MARGIN / 2);
        for (i, value) in (0..).zip([100, 101, 102, 103]) {
            let [x, y] = [MARGIN + i % 2 * pitch[0] + 17, MARGIN + i / 2 * pitch[1] + 14];
            assert_eq!(sheet.get_pixel(x, y).0, [value; 3], "{i}");
        }
        // The box of the defect, one pixel outside of [4, 4, 8, 4].
        assert_eq!(sheet.get_pixel(MARGIN + 3, MARGIN + 5).0, COLORS[0]);
        assert_eq!(sheet.get_pixel(0, 0).0, PAPER);
    }

    #[test]
    fn an_empty_set_has_a_sheet_and_a_wrong_mask_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let view = set(folder.path(), 0, [1, 1]);
        assert!(sheet(&view, MOST_IMAGES, CELL).width() > 100);
        let view = set(folder.path(), 1, [64, 32]);
        fs::create_dir_all(folder.path().join("masks")).expect("a folder");
        let bytes = png(&[0; 100], [10, 10], 1).expect("a picture");
        fs::write(folder.path().join("masks/000000.png"), bytes).expect("written");
        let error = contact_sheet(&view, MOST_IMAGES, CELL).expect_err("another size");
        assert!(error.file.ends_with("masks/000000.png") && error.problem.contains("10 \u{d7} 10"), "{error}");
    }

    #[test]
    fn legends_wrap_within_the_width() {
        let entries: Vec<_> = [50, 60, 200, 10].map(|w| (Entry::Note(String::new()), w)).into();
        let lines: Vec<usize> = wrapped(&entries, 150).iter().map(|l| l.len()).collect();
        assert_eq!(lines, [2, 1, 1]);
        assert!(wrapped(&[], 10).is_empty());
    }
}
