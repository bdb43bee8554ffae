//! Windows and primaries of an EXR: the place of its samples in the picture, and the meaning of its colours.

use super::{Channel, ExrLayers};
use crate::error::InputError;
use exr::meta::attribute::{Chromaticities, IntegerBounds};
use exr::meta::header::Header;
use exr::prelude::Vec2;
use std::path::Path;

/// Red, green, blue and white of Rec. 709 (ITU-R BT.709), as CIE x and y.
const REC_709: [Vec2<f32>; 4] = [Vec2(0.64, 0.33), Vec2(0.30, 0.60), Vec2(0.15, 0.06), Vec2(0.3127, 0.3290)];
/// Primaries within this distance are the same.
const SAME: f32 = 0.003;

/// The windows of an EXR, and the primaries of its colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExrFrame {
    /// Top left pixel of the samples: the place of the data window.
    pub position: Vec2<i32>,
    /// The picture: the display window.
    pub display: IntegerBounds,
    /// The primaries, if the file states them.
    pub chromaticities: Option<Chromaticities>,
}

impl ExrFrame {
    /// `None` if the samples are the picture and no primaries are stated.
    pub(crate) fn of_header(header: &Header) -> Option<Self> {
        let (data, display) = (header.data_window(), header.shared_attributes.display_window);
        let chromaticities = header.shared_attributes.chromaticities;
        let is_plain = data == display && data.position == Vec2(0, 0) && chromaticities.is_none();
        (!is_plain).then_some(Self { position: data.position, display, chromaticities })
    }

    /// Writes windows and primaries into a header.
    pub(super) fn apply(&self, header: &mut Header) {
        header.own_attributes.layer_position = self.position;
        header.shared_attributes.display_window = self.display;
        header.shared_attributes.chromaticities = self.chromaticities;
    }

    /// Problem and help of colours that are not those of Rec. 709.
    pub(crate) fn other_primaries(&self) -> Option<(String, &'static str)> {
        let c = self.chromaticities?;
        let stated = [c.red, c.green, c.blue, c.white];
        if stated.iter().zip(REC_709).all(|(a, b)| (a.0 - b.0).abs().max((a.1 - b.1).abs()) <= SAME) {
            return None;
        }
        let [r, g, b, w] = stated.map(|Vec2(x, y)| format!("{x} {y}"));
        let problem = format!("its primaries (red {r}, green {g}, blue {b}, white {w}) are not those of Rec. 709");
        let help = "convert it to linear Rec. 709, for example ACEScg by `oiiotool in.exr --colorconvert ACEScg \
                    lin_rec709 -o out.exr`";
        Some((problem, help))
    }

    /// The samples of the display window, from those of a data window with this width and height. Where there are none,
    /// they are zero.
    pub(crate) fn displayed<T: Copy + Default>(&self, samples: &[T], [width, height]: [usize; 2]) -> Vec<T> {
        let (to, from) = (self.display.position, self.position);
        let [dx, dy] = [(to.0, from.0), (to.1, from.1)].map(|(to, from)| i64::from(to) - i64::from(from));
        let inside = |i: usize, shift: i64, size: usize| usize::try_from(i as i64 + shift).ok().filter(|i| *i < size);
        let mut out = Vec::with_capacity(self.display.size.area());
        for y in 0..self.display.size.1 {
            let row = inside(y, dy, height).and_then(|y| samples.get(y * width..(y + 1) * width)).unwrap_or_default();
            let sample = |x| inside(x, dx, width).and_then(|x| row.get(x)).copied().unwrap_or_default();
            out.extend((0..self.display.size.0).map(sample));
        }
        out
    }
}

impl ExrLayers {
    /// The picture: the samples in the display window. Samples outside of it are left out, and pixels without samples
    /// are zero.
    pub fn displayed(mut self) -> Self {
        let Some(frame) = self.frame.take() else { return self };
        let size = [self.width as usize, self.height as usize];
        for (_, channel) in &mut self.channels {
            match channel {
                Channel::F32(v) => *v = frame.displayed(v, size),
                Channel::U32(v) => *v = frame.displayed(v, size),
            }
        }
        [self.width, self.height] = [frame.display.size.0 as u32, frame.display.size.1 as u32];
        self
    }

    /// Refuses colours with other primaries than those of Rec. 709.
    ///
    /// # Errors
    /// The file states other primaries.
    pub fn check_primaries(&self, path: &Path) -> Result<(), InputError> {
        match self.frame.and_then(|frame| frame.other_primaries()) {
            Some((problem, help)) => Err(InputError::new(path, "the attribute `chromaticities`", problem, help)),
            None => Ok(()),
        }
    }
}
