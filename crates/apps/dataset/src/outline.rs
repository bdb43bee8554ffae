//! Polygons of binary masks, as COCO stores them.

/// The outlines of a mask.
///
/// A polygon is the list x0, y0, x1, y1, ... of its corners [px]. The corners are corners of pixels: the pixel (x, y)
/// covers the square from (x, y) to (x + 1, y + 1), with (0, 0) at the top left corner of the image. The edges are
/// parallel to the axes. The corners run clockwise in the image (y points down). The last corner joins the first one,
/// which is not repeated. The area inside the polygon is the number of its pixels.
///
/// The rasteriser of COCO (`rleFrPoly` of `maskApi.c`; Lin et al. 2014) takes the pixels whose centre is inside, and
/// rounds coordinates to a fifth of a pixel. So the union of the decoded polygons is exactly the mask if the mask has no
/// holes. The result stays exact if all corners are shifted by up to 0.4 pixels in x and y. A mask with holes comes
/// back with its holes filled, because COCO joins polygons by their union.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Outline {
    /// The outer outline of each 4-connected component, in the order of the topmost pixels of the components, from
    /// left to right in a row. A polygon touches itself in a corner where two of its pixels meet only diagonally.
    pub(crate) polygons: Vec<Vec<f64>>,
    /// The number of holes: 8-connected regions of other pixels that a component encloses. They have no polygon.
    pub(crate) holes: usize,
}

impl Outline {
    /// The polygons if they represent the mask exactly: `None` if the mask has holes or no pixel.
    ///
    /// A caller stores such a mask as run lengths. COCO has no polygon with a hole, and `pycocotools` raises an error
    /// for an empty list of polygons.
    pub(crate) fn exact(self) -> Option<Vec<Vec<f64>>> {
        (self.holes == 0 && !self.polygons.is_empty()).then_some(self.polygons)
    }
}

/// The outlines of the pixels for which `inside(x, y)` is true.
///
/// `bounds` is the box [x, y, width, height] to scan [px]. It contains the mask and is part of the image. The function
/// `inside` is called once for each pixel of the box and never outside. Pixels outside the box do not belong to the
/// mask. An empty mask has no polygons.
///
/// It needs one byte of memory for each pixel of the box. The time depends on the area of the box and the length of
/// the outlines.
pub(crate) fn outline(bounds: [u32; 4], inside: impl Fn(usize, usize) -> bool) -> Outline {
    let grid = &mut Grid::new(bounds, inside);
    let mut result = Outline::default();
    let [left, top, width, height] = bounds.map(f64::from);
    if width * height == 0.0 {
        return result;
    }
    for y in 0..bounds[3] {
        for x in 0..bounds[2] {
            if !grid.starts(x, y) {
                continue;
            }
            let (area, corners) = trace(grid, x, y);
            if area > 0 {
                let place = |&(x, y): &(u32, u32)| [left + f64::from(x), top + f64::from(y)];
                result.polygons.push(corners.iter().flat_map(place).collect());
            } else {
                result.holes += 1;
            }
        }
    }
    result
}

/// The mask has this pixel.
const INSIDE: u8 = 1;
/// An outline contains the upper edge of this pixel already.
const TRACED: u8 = 2;

/// The pixels of the box, row by row.
struct Grid {
    width: u32,
    pixels: Vec<u8>,
}

impl Grid {
    fn new([left, top, width, height]: [u32; 4], inside: impl Fn(usize, usize) -> bool) -> Self {
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height as usize {
            let y = top as usize + y;
            pixels.extend((0..width as usize).map(|x| u8::from(inside(left as usize + x, y)) * INSIDE));
        }
        Self { width, pixels }
    }

    /// The index of a pixel, `None` left and right of the box, maybe too large below it.
    fn index(&self, x: u32, y: u32) -> Option<usize> {
        (x < self.width).then_some(y as usize * self.width as usize + x as usize)
    }

    /// If the mask has the pixel whose lower right corner is (x, y).
    fn has_before(&self, x: u32, y: u32) -> bool {
        let index = x.checked_sub(1).zip(y.checked_sub(1)).and_then(|(x, y)| self.index(x, y));
        index.and_then(|i| self.pixels.get(i)).is_some_and(|pixel| pixel & INSIDE != 0)
    }

    /// If an outline starts at the upper edge of a pixel: the edge borders the mask and no outline contains it yet.
    fn starts(&self, x: u32, y: u32) -> bool {
        let pixel = self.index(x, y).and_then(|i| self.pixels.get(i));
        pixel == Some(&INSIDE) && !self.has_before(x + 1, y)
    }

    /// Marks the upper edge of a pixel as part of an outline.
    fn mark(&mut self, x: u32, y: u32) {
        if let Some(pixel) = self.index(x, y).and_then(|i| self.pixels.get_mut(i)) {
            *pixel |= TRACED;
        }
    }
}

/// The direction of a step along the edges of pixels. The mask is on the right hand.
#[derive(Clone, Copy, PartialEq)]
enum Step {
    Right,
    Down,
    Left,
    Up,
}

impl Step {
    fn turned_right(self) -> Self {
        match self {
            Self::Right => Self::Down,
            Self::Down => Self::Left,
            Self::Left => Self::Up,
            Self::Up => Self::Right,
        }
    }

    fn turned_left(self) -> Self {
        self.turned_right().turned_right().turned_right()
    }
}

/// The closed outline that starts with the upper edge of the pixel (x, y): its signed area and its corners.
///
/// The area is positive for an outer outline and negative for a hole. At a corner where two pixels of the mask meet
/// diagonally, the outline stays with the pixel it comes from. So components are 4-connected, and holes 8-connected.
/// Each edge has one successor and one predecessor, so the outline returns to its start.
fn trace(grid: &mut Grid, start_x: u32, start_y: u32) -> (i64, Vec<(u32, u32)>) {
    let (mut x, mut y, mut step) = (start_x, start_y, Step::Right);
    let (mut area, mut corners) = (0_i64, Vec::new());
    loop {
        match step {
            Step::Right => {
                grid.mark(x, y);
                x += 1;
            }
            Step::Down => {
                y += 1;
                area += i64::from(x);
            }
            Step::Left => x -= 1,
            Step::Up => {
                y -= 1;
                area -= i64::from(x);
            }
        }
        // The pixels on the left and on the right hand after a step straight on.
        let [[above_left, above_right], [below_left, below_right]] =
            [y, y + 1].map(|y| [x, x + 1].map(|x| grid.has_before(x, y)));
        let (left, right) = match step {
            Step::Right => (above_right, below_right),
            Step::Down => (below_right, below_left),
            Step::Left => (below_left, above_left),
            Step::Up => (above_left, above_right),
        };
        let next = match (left, right) {
            (_, false) => step.turned_right(),
            (false, true) => step,
            (true, true) => step.turned_left(),
        };
        if next != step {
            corners.push((x, y));
        }
        step = next;
        if (x, y) == (start_x, start_y) && step == Step::Right {
            return (area, corners);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The outline of a drawing, with `#` for pixels of the mask.
    fn drawn(rows: &[&str]) -> Outline {
        let bounds = [0, 0, rows[0].len() as u32, rows.len() as u32];
        outline(bounds, |x, y| rows[y].as_bytes()[x] == b'#')
    }

    /// The pixels whose centre is inside a polygon with edges parallel to the axes, by the even-odd rule.
    fn fill(polygon: &[f64], width: usize, pixels: &mut [bool]) {
        let corners: Vec<_> = polygon.chunks_exact(2).map(|c| (c[0] as usize, c[1] as usize)).collect();
        for (i, &(x, y)) in corners.iter().enumerate() {
            let (next_x, next_y) = corners[(i + 1) % corners.len()];
            assert!((x == next_x) != (y == next_y), "an edge is not parallel to an axis");
            let (after_x, after_y) = corners[(i + 2) % corners.len()];
            assert!((x != after_x) && (y != after_y), "a corner is not a corner");
            if y == next_y {
                for column in x.min(next_x)..x.max(next_x) {
                    pixels.iter_mut().skip(y * width + column).step_by(width).for_each(|pixel| *pixel ^= true);
                }
            }
        }
    }

    #[test]
    fn simple_shapes_have_the_corners_of_their_pixels() {
        assert_eq!(drawn(&["#"]).polygons, [[1., 0., 1., 1., 0., 1., 0., 0.]]);
        assert_eq!(drawn(&["...", ".##"]).polygons, [[3., 1., 3., 2., 1., 2., 1., 1.]]);
        assert_eq!(drawn(&["#.", "##"]).polygons, [[1., 0., 1., 1., 2., 1., 2., 2., 0., 2., 0., 0.]]);
        assert_eq!(drawn(&["#", "#", ".", "#"]).polygons.len(), 2);
        assert_eq!(drawn(&["..", ".."]), Outline::default());
        assert_eq!(drawn(&["..", ".."]).exact(), None);
        assert_eq!(outline([3, 4, 0, 7], |_, _| true), Outline::default());
        assert_eq!(outline([3, 4, 7, 0], |_, _| true), Outline::default());
    }

    #[test]
    fn holes_are_counted() {
        let ring = drawn(&["###", "#.#", "###"]);
        assert_eq!((ring.polygons.len(), ring.holes), (1, 1));
        assert_eq!(ring.exact(), None);
        // Two background pixels that touch diagonally are one hole.
        assert_eq!(drawn(&["####", "#.##", "##.#", "####"]).holes, 1);
        assert_eq!(drawn(&["#####", "#.#.#", "#####"]).holes, 2);
        // A background pixel with a diagonal way out is no hole, and the outline touches itself.
        let open = drawn(&["###", "#.#", "##."]);
        assert_eq!((open.polygons.len(), open.holes), (1, 0));
        // Pixels that touch diagonally are two components, and enclose nothing.
        let diamond = drawn(&[".#.", "#.#", ".#."]);
        assert_eq!((diamond.polygons.len(), diamond.holes), (4, 0));
        // A component inside a hole has its own outline.
        let nested = drawn(&["#####", "#...#", "#.#.#", "#...#", "#####"]);
        assert_eq!((nested.polygons.len(), nested.holes), (2, 1));
    }

    #[test]
    fn only_the_box_is_scanned() {
        let found = outline([5, 7, 2, 3], |x, y| {
            assert!((5..7).contains(&x) && (7..10).contains(&y));
            true
        });
        assert_eq!(found.polygons, [[7., 7., 7., 10., 5., 10., 5., 7.]]);
    }

    #[test]
    fn polygons_of_random_masks_give_the_mask_back() {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let mut exact = 0;
        for (width, height) in [(1, 1), (1, 9), (9, 1), (4, 4), (17, 12)] {
            for density in [10, 50, 90] {
                for _ in 0..40 {
                    let mask: Vec<bool> = (0..width * height).map(|_| next() % 100 < density).collect();
                    let found = outline([0, 0, width as u32, height as u32], |x, y| mask[y * width + x]);
                    // Components do not overlap, so the even-odd rule over all polygons is their union, except for
                    // components in holes.
                    let mut filled = vec![false; width * height];
                    for polygon in &found.polygons {
                        let mut one = vec![false; width * height];
                        fill(polygon, width, &mut one);
                        filled.iter_mut().zip(one).for_each(|(all, one)| *all |= one);
                    }
                    assert!(filled.iter().zip(&mask).all(|(filled, mask)| filled >= mask));
                    assert_eq!(filled == mask, found.holes == 0);
                    exact += usize::from(filled == mask);
                }
            }
        }
        assert!(exact > 300, "{exact}");
    }
}
