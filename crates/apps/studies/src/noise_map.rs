//! The noise map of a film: for each pixel, the noise of the render over that of the camera.

use crate::report::maps::{SIGNED, color, gradient};
use dunkelfeld::film::{Certified, Plane};
use dunkelfeld::outputs::encode_picture;
use dunkelfeld::{Error, Picture};
use dunkelfeld_io::png::data_uri;
use dunkelfeld_report::words::rounded;
use maud::html;

/// The colours end at k / 8 and at 8 k: a factor of 8 in noise is one of 64 in samples.
const REACH: f64 = 8.0;
/// Pixels whose noise is unknown: darker than all colours of the scale.
const UNKNOWN: [u8; 3] = [20, 20, 20];
/// Smallest width of the picture in a notebook \[pixels of the screen\].
const SHOWN_WIDTH: u32 = 384;

/// Standard deviation of the rendered mean over that of the camera, per pixel, at a level k.
///
/// The picture has a logarithmic scale of colours: blue where the noise is hidden (k / 8 and less at the end), grey at k,
/// orange where it is visible (8 k and more at the end), nearly black where it is unknown. Readers with a colour vision
/// deficiency distinguish blue and orange.
#[derive(Clone, Debug)]
pub struct NoiseMap {
    ratios: Plane<f32>,
    k: f64,
    hidden: f64,
}

impl NoiseMap {
    /// The map of a film with its certificate.
    pub fn new(certified: &Certified) -> Self {
        let certificate = &certified.certificate;
        let ratios = certified.ratios.map(|v| v.sqrt());
        Self { ratios, k: certificate.k, hidden: certificate.hidden }
    }

    /// The map of ratios that another map had, with its level and its share of hidden pixels.
    pub fn from_parts(ratios: Plane<f32>, k: f64, hidden: f64) -> Self {
        Self { ratios, k, hidden }
    }

    /// The ratios of the standard deviations; infinite where the noise of the render is unknown.
    pub fn ratios(&self) -> &Plane<f32> {
        &self.ratios
    }

    /// The level k in the middle of the scale.
    pub fn k(&self) -> f64 {
        self.k
    }

    /// Share of the unsaturated pixels whose ratio is at most k.
    pub fn hidden(&self) -> f64 {
        self.hidden
    }

    /// The ratios at the ends of the scale.
    pub fn range(&self) -> [f64; 2] {
        [self.k / REACH, self.k * REACH]
    }

    /// The picture, one pixel for each pixel of the film.
    pub fn picture(&self) -> Plane<[u8; 3]> {
        self.ratios.map(|&ratio| self.color_of(f64::from(ratio)))
    }

    fn color_of(&self, ratio: f64) -> [u8; 3] {
        if !ratio.is_finite() {
            return UNKNOWN;
        }
        // Zero has the logarithm of minus infinity, which is the first colour.
        color(&SIGNED, 0.5 + 0.5 * (ratio / self.k).ln() / REACH.ln())
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn png(&self) -> Result<Vec<u8>, Error> {
        encode_picture(&Picture::Rgb(self.picture()))
    }

    /// The picture with its scale, as a figure of HTML that needs no style sheet and no other file.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn html(&self) -> Result<String, Error> {
        let picture = self.picture();
        let uri = data_uri(dunkelfeld_io::picture::Picture::Rgb8(&picture))
            .map_err(|e| Error::setting("noise map", e.to_string(), "render an image with pixels"))?;
        // Small pictures are enlarged by a whole factor.
        let width = picture.width() * (SHOWN_WIDTH / picture.width().max(1)).max(1);
        let [low, high] = self.range();
        let unknown = self.ratios.data().iter().any(|v| !v.is_finite());
        let figure = html! {
            figure style={ "margin:0;max-width:100%;font-size:smaller;width:" (width) "px" } {
                img src=(uri) alt="noise map" style="width:100%;image-rendering:pixelated;display:block";
                div style={ "height:0.8em;margin-top:0.3em;background:" (gradient(true)) } {}
                div style="display:flex;justify-content:space-between" {
                    span { (rounded(low)) } span { (rounded(self.k)) " = k" } span { (rounded(high)) }
                }
                figcaption {
                    "noise of the render over that of the camera; hidden at k in " (rounded(100.0 * self.hidden)) " % of the pixels"
                    @if unknown { "; black: unknown" }
                }
            }
        };
        Ok(figure.into_string())
    }
}
