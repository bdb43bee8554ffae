//! Labels over a picture: outlines of a mask or boxes, in the colour of their category, with a dark halo.
//!
//! The colours are bright, so that they show on dark pixels. The halo shows on bright ones.

use super::picture::Mask;
use super::view::{Record, SetView};
use std::collections::HashMap;

/// Colours of categories, in the order of the set. They are the colours of the charts for dark surroundings, and white.
pub(crate) const COLORS: [[u8; 3]; dunkelfeld_report::chart::COLORS] =
    [[93, 181, 234], [255, 143, 80], [63, 207, 159], [238, 159, 203], [242, 195, 78], [255, 255, 255]];
/// The opacity of the halo.
const HALO: u8 = 190;
/// Instances smaller than this in the picture [px] have a box around them, because an outline would hide them.
const SMALL: i64 = 10;
/// Distance of a box from its instance [px].
const GAP: i64 = 3;
/// Distance of an outline from a defect [px], so that both sides of a scratch stay visible.
const CLEAR: usize = 2;
/// Pictures with at least this long side [px] have lines of two pixels around defects.
const THICK: u32 = 200;

/// The lines over a picture: per pixel its colour and opacity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Overlay {
    pub(crate) size: [u32; 2],
    pub(crate) rgba: Vec<u8>,
}

/// The style of an instance: position of its category in the set, and rank of its lines.
#[derive(Clone, Copy, Debug)]
struct Pen {
    category: usize,
    is_defect: bool,
}

/// The lines while they are drawn.
struct Canvas {
    size: [i64; 2],
    /// The instance of each pixel.
    ids: Vec<u64>,
    /// The instance whose line is at a pixel.
    lines: Vec<Option<u64>>,
    pens: HashMap<u64, Pen>,
}

impl Overlay {
    /// The labels of a record over a picture that was scaled from `full` to `size`: outlines if there is a mask, boxes
    /// otherwise.
    pub(crate) fn new(view: &SetView, record: &Record, mask: Option<&Mask>, full: [u32; 2], size: [u32; 2]) -> Self {
        let mut canvas = Canvas::new(view, record, mask, size);
        let width = if size[0].max(size[1]) < THICK { 1 } else { 2 };
        match mask {
            Some(_) => canvas.outlines(width),
            None => canvas.boxes(record, full, width),
        }
        Self { size, rgba: canvas.painted() }
    }

    /// Blends the lines over RGB pixels of the same size.
    pub(crate) fn blend(&self, rgb: &mut [u8]) {
        for (pixel, over) in rgb.chunks_exact_mut(3).zip(self.rgba.chunks_exact(4)) {
            let opacity = u32::from(over[3]);
            for (v, c) in pixel.iter_mut().zip(over) {
                *v = ((u32::from(*v) * (255 - opacity) + u32::from(*c) * opacity + 127) / 255) as u8;
            }
        }
    }
}

impl Canvas {
    fn new(view: &SetView, record: &Record, mask: Option<&Mask>, size: [u32; 2]) -> Self {
        let named = view.head.instances.iter().map(|i| (i.id, i.category));
        // The record has the last word: its ids are those of its mask.
        let all = named.chain(record.instances.iter().map(|l| (l.id, l.category)));
        let pen = |category: u64| {
            let position = view.position(category).unwrap_or(COLORS.len() - 1);
            Pen { category: position, is_defect: view.head.categories.get(position).is_some_and(|c| c.is_defect) }
        };
        let ids = match mask {
            Some(mask) => mask.shrunk(size).into_iter().map(u64::from).collect(),
            None => vec![0; size[0] as usize * size[1] as usize],
        };
        let pens = all.map(|(id, category)| (id, pen(category))).collect();
        Self { size: size.map(i64::from), lines: vec![None; ids.len()], ids, pens }
    }

    fn at(&self, [x, y]: [i64; 2]) -> Option<usize> {
        let is_inside = (0..self.size[0]).contains(&x) && (0..self.size[1]).contains(&y);
        is_inside.then_some((y * self.size[0] + x) as usize)
    }

    fn place(&self, at: usize) -> [i64; 2] {
        let width = self.size[0].max(1);
        [at as i64 % width, at as i64 / width]
    }

    fn around(&self, at: usize) -> impl Iterator<Item = usize> {
        let [x, y] = self.place(at);
        let steps = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy])).filter(|step| *step != [0, 0]);
        steps.filter_map(move |[dx, dy]| self.at([x + dx, y + dy]))
    }

    /// Lines of an instance are drawn over those of lower rank: first none, then objects, then defects.
    fn rank(&self, id: u64) -> (u8, u64) {
        match self.pens.get(&id) {
            _ if id == 0 => (0, 0),
            Some(pen) if pen.is_defect => (2, id),
            _ => (1, id),
        }
    }

    /// Width of the lines of an instance, and their distance from it [px].
    fn line(&self, id: u64, width: usize) -> [usize; 2] {
        if self.rank(id).0 == 2 { [width, CLEAR] } else { [1, 0] }
    }

    /// Lines around the area of each instance. They are outside of it, so that they do not hide it.
    fn outlines(&mut self, width: usize) {
        let extents = self.extents();
        let is_small = |[x0, y0, x1, y1]: [i64; 4]| x1 - x0 < SMALL && y1 - y0 < SMALL;
        let small: HashMap<u64, [i64; 4]> = extents.into_iter().filter(|(_, e)| is_small(*e)).collect();
        // Each step adds a ring of one pixel around the areas: first the clear rings, then the line.
        let mut areas: Vec<u64> = self.ids.iter().map(|id| if small.contains_key(id) { 0 } else { *id }).collect();
        for step in 0..width + CLEAR {
            let mut wider = areas.clone();
            for (at, area) in wider.iter_mut().enumerate() {
                let rank = self.rank(self.ids[at]).max(self.rank(*area));
                let is_growing = |id: &u64| *id > 0 && step < self.line(*id, width).iter().sum::<usize>();
                let around = self.around(at).map(|i| areas[i]).filter(is_growing).filter(|id| self.rank(*id) > rank);
                let Some(id) = around.max_by_key(|id| self.rank(*id)) else { continue };
                *area = id;
                self.lines[at] = (step >= self.line(id, width)[1]).then_some(id);
            }
            areas = wider;
        }
        let mut small: Vec<(u64, [i64; 4])> = small.into_iter().collect();
        small.sort_unstable();
        for (id, [x0, y0, x1, y1]) in small {
            let width = self.line(id, width)[0];
            self.frame(id, [x0 - GAP, y0 - GAP, x1 + GAP, y1 + GAP], width);
        }
    }

    /// The first and the last column and row of each instance.
    fn extents(&self) -> HashMap<u64, [i64; 4]> {
        let mut extents = HashMap::new();
        for (at, id) in self.ids.iter().enumerate().filter(|(_, id)| **id > 0) {
            let [x, y] = self.place(at);
            let e = extents.entry(*id).or_insert([x, y, x, y]);
            *e = [e[0].min(x), e[1].min(y), e[2].max(x), e[3].max(y)];
        }
        extents
    }

    /// The boxes of a record. `full` is the size of its image.
    fn boxes(&mut self, record: &Record, full: [u32; 2], width: usize) {
        let [sx, sy] = [0, 1].map(|i| self.size[i] as f64 / f64::from(full[i].max(1)));
        let labels = record.instances.iter().filter_map(|l| Some((l.id, l.bbox?)));
        for (id, [x, y, w, h]) in labels.filter(|(_, b)| b.iter().all(|v| v.is_finite()) && b[2] > 0.0 && b[3] > 0.0) {
            let whole = |v: f64| v.clamp(-1e6, 1e6) as i64;
            let [x0, y0] = [whole((x * sx).floor()), whole((y * sy).floor())];
            let [x1, y1] = [whole(((x + w) * sx).ceil()) - 1, whole(((y + h) * sy).ceil()) - 1];
            let width = self.line(id, width)[0];
            self.frame(id, [x0 - 1, y0 - 1, x1 + 1, y1 + 1], width);
        }
    }

    /// A box with its first and last column and row. Parts beyond the picture are moved to its edge.
    fn frame(&mut self, id: u64, [x0, y0, x1, y1]: [i64; 4], width: usize) {
        let clamped = |v: i64, i: usize| v.clamp(0, (self.size[i] - 1).max(0));
        for step in 0..width as i64 {
            let (x0, y0) = (clamped(x0 - step, 0), clamped(y0 - step, 1));
            let (x1, y1) = (clamped(x1 + step, 0), clamped(y1 + step, 1));
            let rows = (x0..=x1).flat_map(|x| [[x, y0], [x, y1]]);
            let places: Vec<[i64; 2]> = rows.chain((y0..=y1).flat_map(|y| [[x0, y], [x1, y]])).collect();
            for at in places {
                if let Some(line) = self.at(at).and_then(|i| self.lines.get_mut(i)) {
                    *line = Some(id);
                }
            }
        }
    }

    fn painted(&self) -> Vec<u8> {
        let paint = |at: usize| -> [u8; 4] {
            let Some(id) = self.lines[at] else {
                let is_beside = self.around(at).any(|i| self.lines[i].is_some_and(|id| id != self.ids[at]));
                return if is_beside { [0, 0, 0, HALO] } else { [0; 4] };
            };
            let category = self.pens.get(&id).map_or(COLORS.len() - 1, |p| p.category);
            let [x, y] = self.place(at);
            match is_gap(category, x + y) {
                true => [0, 0, 0, HALO],
                false => {
                    let [r, g, b] = COLORS[category % COLORS.len()];
                    [r, g, b, 255]
                }
            }
        };
        (0..self.ids.len()).flat_map(paint).collect()
    }
}

/// Styles of lines. Categories with the same colour have them in turn.
pub(crate) const STYLES: usize = 4;

/// The style of the lines of a category: 0 solid, 1 dashes, 2 dots, 3 dashes and dots.
pub(crate) fn style_of(category: usize) -> usize {
    category / COLORS.len() % STYLES
}

/// Is a pixel of a line of a category in a gap? `along` counts the pixels of the line.
fn is_gap(category: usize, along: i64) -> bool {
    match style_of(category) {
        0 => false,
        1 => along.rem_euclid(8) >= 5,
        2 => along.rem_euclid(4) >= 2,
        _ => matches!(along.rem_euclid(12), 5..=6 | 9..=11),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake;

    fn view(folder: &std::path::Path) -> (SetView, Record) {
        fake::write(folder, &[fake::record(0)]);
        let view = SetView::read(folder).expect("a set");
        let record = view.record(0).expect("a record");
        (view, record)
    }

    fn pixel(overlay: &Overlay, x: u32, y: u32) -> [u8; 4] {
        let at = 4 * (y * overlay.size[0] + x) as usize;
        std::array::from_fn(|i| overlay.rgba[at + i])
    }

    #[test]
    fn categories_differ_in_colour_or_style() {
        let of = |category: usize| {
            let gaps: Vec<bool> = (0..24).map(|along| is_gap(category, along)).collect();
            (COLORS[category % COLORS.len()], gaps)
        };
        let all: std::collections::HashSet<_> = (0..COLORS.len() * STYLES).map(of).collect();
        assert_eq!(all.len(), 24);
        assert_eq!(of(24), of(0));
    }

    #[test]
    fn boxes_are_around_their_labels() {
        let folder = tempfile::tempdir().expect("a folder");
        let (view, record) = view(folder.path());
        let overlay = Overlay::new(&view, &record, None, [64, 32], [64, 32]);
        let [r, g, b] = COLORS[0];
        // The box [8, 8, 16, 8] has its line one pixel outside, and a halo on both sides.
        for (x, y) in [(7, 7), (24, 7), (7, 16), (24, 16), (15, 7)] {
            assert_eq!(pixel(&overlay, x, y), [r, g, b, 255], "{x} {y}");
        }
        assert_eq!([pixel(&overlay, 8, 8), pixel(&overlay, 6, 6)], [[0, 0, 0, HALO]; 2]);
        assert_eq!(pixel(&overlay, 12, 12), [0; 4]);
        assert_eq!(pixel(&overlay, 39, 3)[..3], COLORS[1]);
    }

    #[test]
    fn outlines_are_outside_of_their_instance_and_defects_stay_visible() {
        let folder = tempfile::tempdir().expect("a folder");
        let (view, record) = view(folder.path());
        // An object from 4 to 59, with a scratch of one row on it.
        let id = |x: u32, y: u32| match (x, y) {
            (10..40, 12) => 3,
            (4..60, 4..28) => 4,
            _ => 0,
        };
        let ids = (0..32).flat_map(|y| (0..64).map(move |x| id(x, y))).collect();
        let mask = Mask { width: 64, height: 32, ids };
        let overlay = Overlay::new(&view, &record, Some(&mask), [64, 32], [64, 32]);
        assert_eq!(pixel(&overlay, 20, 12), [0; 4]);
        assert_eq!(
            [pixel(&overlay, 20, 11), pixel(&overlay, 20, 9)],
            [[0, 0, 0, 0], [COLORS[0][0], COLORS[0][1], COLORS[0][2], 255]]
        );
        assert_eq!([pixel(&overlay, 20, 8), pixel(&overlay, 20, 10)], [[0, 0, 0, HALO]; 2]);
        assert_eq!(pixel(&overlay, 3, 20)[..3], COLORS[1]);
        assert_eq!(pixel(&overlay, 2, 20), [0, 0, 0, HALO]);
        assert_eq!(pixel(&overlay, 30, 20), [0; 4]);
    }

    #[test]
    fn small_instances_have_a_box_and_odd_labels_do_no_harm() {
        let folder = tempfile::tempdir().expect("a folder");
        let (view, mut record) = view(folder.path());
        let mut mask = Mask { width: 64, height: 32, ids: vec![0; 64 * 32] };
        mask.ids[10 * 64 + 30] = 3;
        mask.ids[0] = 9999;
        let overlay = Overlay::new(&view, &record, Some(&mask), [64, 32], [64, 32]);
        assert_eq!(pixel(&overlay, 27, 7)[..3], COLORS[0]);
        assert_eq!(pixel(&overlay, 30, 10), [0; 4]);
        record.instances[0].bbox = Some([-1e30, f64::NAN, 1e30, 4.0]);
        record.instances[1].bbox = Some([-1e30, -5.0, 2e30, 1e30]);
        assert_eq!(Overlay::new(&view, &record, None, [64, 32], [1, 1]).rgba.len(), 4);
    }

    #[test]
    fn halo_and_colour_are_blended() {
        let overlay = Overlay { size: [3, 1], rgba: vec![0, 0, 0, 0, 0, 0, 0, HALO, 1, 2, 3, 255] };
        let mut rgb = [200; 9];
        overlay.blend(&mut rgb);
        assert_eq!(rgb, [200, 200, 200, 51, 51, 51, 1, 2, 3]);
    }
}
