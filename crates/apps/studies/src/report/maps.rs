//! Planes of numbers as pictures: false colours that colour-blind readers can also distinguish, with the ends of their
//! scale.

use dunkelfeld::Error;
use dunkelfeld::film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::data_uri;
use dunkelfeld_report::words::rounded;
use maud::{Markup, Render, html};

/// From dark to bright: the map "viridis" of S. van der Walt and N. Smith (2015, public domain), every eighth of it.
const BRIGHTER: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];
/// From one sign to the other through grey: blue, and orange. Both ends are equally dark.
pub(crate) const SIGNED: [[u8; 3]; 5] = [[5, 80, 160], [110, 165, 215], [236, 236, 236], [226, 150, 80], [165, 70, 0]];
/// Maps larger than this on their long side are averaged down to it.
const LONGEST: u32 = 640;
/// Maximum number of decades of a logarithmic map, from its largest value.
const DECADES: f64 = 4.0;

/// A map, ready for the page.
#[derive(Clone, Debug)]
pub(crate) struct Map {
    /// The picture, as the address of an image.
    pub(crate) uri: String,
    pub(crate) size: [u32; 2],
    pub(crate) caption: String,
    /// The labels at the left and at the right end of the scale.
    pub(crate) ends: [String; 2],
    /// Does the scale contain zero?
    pub(crate) is_signed: bool,
}

/// The map with its scale and its caption.
impl Render for Map {
    fn render(&self) -> Markup {
        html! {
            figure {
                img src=(self.uri) alt=(self.caption) width=(self.size[0]) height=(self.size[1]);
                div.scale style={ "background:" (gradient(self.is_signed)) } {}
                div.ends { span { (self.ends[0]) } span { (self.ends[1]) } }
                figcaption { (self.caption) }
            }
        }
    }
}

/// A map of numbers that are not negative, on a logarithmic scale that ends at the 99.9 % quantile of `like`. The
/// colours of two maps with the same `like` can be compared.
pub(crate) fn logarithmic(plane: &Plane<f64>, like: &Plane<f64>, unit: &str, caption: String) -> Result<Map, Error> {
    let (plane, like) = (shrunk(plane), shrunk(like));
    let mut values: Vec<f64> = like.data().iter().copied().filter(|v| v.is_finite() && *v > 0.0).collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * values.len().saturating_sub(1) as f64) as usize).copied();
    let high = at(0.999).unwrap_or(1.0);
    let low = at(0.01).unwrap_or(0.1).clamp(high * 10f64.powf(-DECADES), high * 0.5);
    let share = |v: f64| (v.max(low) / low).ln() / (high / low).ln();
    let ends = [format!("{} {unit}", rounded(low)), format!("{} {unit}", rounded(high))];
    map(&plane, |v| color(&BRIGHTER, share(v)), caption, ends, false)
}

/// A map of numbers from zero, on a linear scale that ends at the 99.9 % quantile.
pub(crate) fn linear(plane: &Plane<f64>, unit: &str, caption: String) -> Result<Map, Error> {
    let plane = shrunk(plane);
    let mut values: Vec<f64> = plane.data().iter().copied().filter(|v| v.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let top = values.get((0.999 * values.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(0.0);
    let high = if top > 0.0 { top } else { 1.0 };
    let ends = [format!("0 {unit}"), format!("{} {unit}", rounded(high))];
    map(&plane, |v| color(&BRIGHTER, v / high), caption, ends, false)
}

/// A map of numbers of either sign, from `-reach` to `reach`.
pub(crate) fn signed(plane: &Plane<f64>, reach: f64, unit: &str, caption: String) -> Result<Map, Error> {
    let ends = [format!("\u{2212}{} {unit}", rounded(reach)), format!("+{} {unit}", rounded(reach))];
    map(&shrunk(plane), |v| color(&SIGNED, 0.5 + 0.5 * v / reach), caption, ends, true)
}

fn map(
    plane: &Plane<f64>,
    paint: impl Fn(f64) -> [u8; 3],
    caption: String,
    ends: [String; 2],
    is_signed: bool,
) -> Result<Map, Error> {
    let picture = plane.map(|&v| paint(v));
    let uri = encoded(Picture::Rgb8(&picture))?;
    Ok(Map { uri, size: [plane.width(), plane.height()], caption, ends, is_signed })
}

/// A grey picture as the address of an image. If it is too large for a page, only its middle is shown. It is never
/// averaged, because averaging would reduce the noise that it shows.
pub(crate) fn grey(plane: &Plane<u8>) -> Result<(String, [u32; 2]), Error> {
    const LARGEST: u32 = 1024;
    let size = [plane.width().min(LARGEST), plane.height().min(LARGEST)];
    let [x0, y0] = [(plane.width() - size[0]) / 2, (plane.height() - size[1]) / 2];
    let part = Plane::from_fn(size[0], size[1], |x, y| *plane.at(x0 + x, y0 + y));
    Ok((encoded(Picture::Gray8(&part))?, size))
}

fn encoded(picture: Picture<'_>) -> Result<String, Error> {
    data_uri(picture).map_err(|e| Error::setting("report", format!("a picture cannot be encoded: {e}"), "report this"))
}

/// A gradient for style sheets.
pub(crate) fn gradient(is_signed: bool) -> String {
    let stops: &[[u8; 3]] = if is_signed { &SIGNED } else { &BRIGHTER };
    let colors: Vec<String> = stops.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    format!("linear-gradient(90deg,{})", colors.join(","))
}

/// The colour at a share of the scale, between the nearest two of its stops.
pub(crate) fn color(stops: &[[u8; 3]], share: f64) -> [u8; 3] {
    // NaN, which should not occur, becomes the first colour.
    let at = if share > 0.0 { share.min(1.0) } else { 0.0 } * (stops.len() - 1) as f64;
    let (i, part) = ((at as usize).min(stops.len() - 2), at);
    let part = part - i as f64;
    std::array::from_fn(|c| (f64::from(stops[i][c]) * (1.0 - part) + f64::from(stops[i + 1][c]) * part).round() as u8)
}

/// A plane averaged over whole blocks until it is no longer than [`LONGEST`].
fn shrunk(plane: &Plane<f64>) -> Plane<f64> {
    let block = plane.width().max(plane.height()).div_ceil(LONGEST).max(1);
    if block == 1 {
        return plane.clone();
    }
    let (width, height) = (plane.width().div_ceil(block), plane.height().div_ceil(block));
    Plane::from_fn(width, height, |x, y| {
        let (xs, ys) =
            (x * block..((x + 1) * block).min(plane.width()), y * block..((y + 1) * block).min(plane.height()));
        let n = f64::from(xs.len() as u32 * ys.len() as u32);
        ys.flat_map(|y| xs.clone().map(move |x| (x, y))).map(|(x, y)| plane.at(x, y)).sum::<f64>() / n
    })
}
