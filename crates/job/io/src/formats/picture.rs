//! The content of an 8- or 16-bit image file.

use dunkelfeld_film::Plane;

/// A plane of grey values or triples, by depth. 8-bit pictures are gamma-2.2 encoded, 16-bit ones are linear DN,
/// right-aligned: a 12-bit sensor ends at 4095.
#[derive(Clone, Copy, Debug)]
pub enum Picture<'a> {
    /// 8-bit grey.
    Gray8(&'a Plane<u8>),
    /// 8-bit red, green, blue.
    Rgb8(&'a Plane<[u8; 3]>),
    /// 16-bit grey.
    Gray16(&'a Plane<u16>),
    /// 16-bit red, green, blue.
    Rgb16(&'a Plane<[u16; 3]>),
}

impl Picture<'_> {
    /// Width and height in pixels.
    pub fn size(&self) -> (u32, u32) {
        match self {
            Self::Gray8(p) => (p.width(), p.height()),
            Self::Rgb8(p) => (p.width(), p.height()),
            Self::Gray16(p) => (p.width(), p.height()),
            Self::Rgb16(p) => (p.width(), p.height()),
        }
    }
}
